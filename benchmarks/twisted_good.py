"""A good specimen of a folder of held parts, and what a changed CAD file says against it.

Millimetres, CAD frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trace_held import FILES
from trace_held_defects import Built, free_spot, tolerance_mm
from trace_held_parts import FAMILIES, NOMINAL_SAG_MM, HeldPart, Hole, drawn, read_held_part

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid
Words = dict[str, Any]

BEYOND_MM = 0.02  # beyond the limit, so that no reading of the limit calls it right
AROUND_MM = 0.6  # of metal round a new hole, of plane surface round a new boss


@dataclass(frozen=True, eq=False)
class Good:
    """A good specimen of a folder.

    Attributes
    ----------
    truth : as truth.json has it
    part : as drawn
    body : as drawn, with the CAD file's tessellation
    holes : as they are, by id, CAD frame
    boxes : of the grippers of all views in the part's frame: pose, half sizes
    others : CAD solids of the folder's other parts, by name
    """

    truth: Words
    part: HeldPart
    body: Body
    holes: Mapping[str, Hole]
    boxes: Sequence[tuple[Array, Array]] = ()
    others: Mapping[str, Body] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Twist:
    """A changed CAD solid, and what is wrong with the specimen against it.

    Attributes
    ----------
    body : of the CAD file to judge by
    truth : of the specimen against that file, in the words of truth.json
    """

    body: Body
    truth: Words


def part_of(name: str) -> HeldPart:
    """Return a part of a folder by its name.

    Raises
    ------
    ValueError : of no family, and none of the files
    """
    family, _, number = name.rpartition("_")
    if family in FAMILIES and number.isdigit():
        return drawn(family, int(number))
    for path in (p for side in FILES.values() for p in side):
        if path.name.split(".")[0] == name:
            return read_held_part(path)
    raise ValueError(f"{name}: no such part to hold")


def good_of(
    truth: Words, words: Words | None = None, others: Mapping[str, Body] | None = None
) -> Good:
    """Return a good specimen.

    Parameters
    ----------
    truth : of truth.json
    words : of SET.json, where grippers are to be kept clear of
    others : CAD solids of other parts, by name
    """
    part = part_of(truth["part"])
    body = part.build(sag_mm=NOMINAL_SAG_MM)
    nominal = {h.id: h for h in part.holes}
    holes = {}
    for told in truth["holes"]:
        ends = np.array(told["true_ends"])
        holes[told["id"]] = replace(
            nominal[told["id"]], mouth_mm=ends[0], bottom_mm=ends[1], diameter_mm=told["true_d_mm"]
        )
    boxes = []
    for view, pose in zip((words or {}).get("views", []), truth["poses"], strict=False):
        T_part_world = np.linalg.inv(np.array(pose["T_world_part_true"]))
        for box in view["gripper_boxes"]:
            boxes.append((T_part_world @ np.array(box["T"]), np.array(box["half_mm"])))
    return Good(truth, part, body, holes, boxes, others or {})


def extents(body: Body) -> Array:
    return np.asarray(np.ptp(np.array(body.bounding_box()).reshape(2, 3), axis=0))


def limit_mm(good: Good) -> float:
    """Return the widest limit of a place on this part: that of its longest diagonal."""
    return tolerance_mm(float(np.linalg.norm(extents(good.body))))


def plane_spot(good: Good, rng: np.random.Generator, radius_mm: float) -> tuple[Array, Array]:
    as_drawn = Built(good.body, {}, {}, good.body)
    return free_spot(as_drawn, rng, radius_mm, plane=True)
