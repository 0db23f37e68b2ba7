"""CAD files changed so that a good specimen has a known defect against them.

The pictures stay; what they are judged by is twisted. A hole more in the CAD file is a hole missing
on the part, a boss less is a boss too many. Every kind draws from a generator, so that one good
specimen gives many defects, at a judgement's cost and without a tracer.

A size counts as wrong only where the specimen *as built*, not as drawn, is beyond the widest limit
that ISO 2768-m gives lengths of the part's size. Millimetres, CAD frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from trace_held_defects import NoPlaceError
from twisted_features import (
    boss_extra,
    boss_missing,
    chamfer_missing,
    cut_extra,
    cut_moved,
    face_off,
    notch_missing,
    rib_missing,
)
from twisted_good import Good, Twist
from twisted_holes import (
    hole_depth_off,
    hole_extra,
    hole_half_deep,
    hole_large,
    hole_missing,
    hole_position,
    hole_small,
    hole_too_deep,
)
from twisted_whole import mirrored, wrong_part, wrong_revision

Body = Any  # manifold3d's solid

TRY_COUNT = 40

KINDS: dict[str, Callable[[Good, np.random.Generator], Twist]] = {
    f.__name__: f
    for f in (
        hole_missing, hole_extra, hole_position, hole_small, hole_large, hole_half_deep,
        hole_depth_off, hole_too_deep, boss_missing, rib_missing, boss_extra, cut_extra, cut_moved,
        face_off, chamfer_missing, notch_missing, mirrored, wrong_revision, wrong_part,
    )
}  # fmt: skip


def twisted(good: Good, kind: str, rng: np.random.Generator) -> Twist:
    """Return a changed CAD file against which a good specimen has a defect of a kind.

    Raises
    ------
    NoPlaceError : this part cannot have it
    """
    for _ in range(TRY_COUNT):
        twist = KINDS[kind](good, rng)
        changed = (twist.body - good.body).volume() + (good.body - twist.body).volume()
        if not twist.body.is_empty() and changed > 1e-2 and _is_whole(twist.body):
            break
    else:
        raise NoPlaceError(f"{good.part.name}: {kind} changes nothing, or tears the part")
    truth = good.truth | {"dims": {}} | twist.truth
    return replace(twist, truth=truth | {"cls": "defect", "kind": kind, "expected": "fail"})


def _is_whole(body: Body) -> bool:
    pieces = body.decompose()
    return sum(p.volume() > 1e-3 * body.volume() for p in pieces) == 1
