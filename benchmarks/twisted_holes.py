"""CAD files with other holes than a good specimen has: more, fewer, elsewhere, of another size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trace_held_defects import (
    AS_BUILT_MM,
    NoPlaceError,
    across,
    pick,
    told_words,
    tolerance_mm,
)
from trace_held_parts import NOMINAL_SAG_MM, Hole, bore, rod, triangles_of
from twisted_good import AROUND_MM, BEYOND_MM, Good, Twist, extents, limit_mm, plane_spot

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid
Words = dict[str, Any]

SHIFTS_MM = (0.35, 0.4, 0.5, 0.7, 1.0)
RESIZES_MM = (0.3, 0.4, 0.5, 0.7, 1.0)


def _hole_words(hole: Hole, now: Hole | None) -> Words:
    """Return a hole as truth.json has it: as the CAD file says, and as it is."""
    words: Words = {
        "id": hole.id,
        "axis": hole.axis.tolist(),
        "nominal_d_mm": hole.diameter_mm,
        "nominal_ends": [hole.mouth_mm.tolist(), hole.bottom_mm.tolist()],
        "exists": now is not None,
    }
    if now is not None:
        words |= {"true_d_mm": now.diameter_mm,
                  "true_ends": [now.mouth_mm.tolist(), now.bottom_mm.tolist()]}  # fmt: skip
    return words


def _with_hole(good: Good, hole: Hole, kept: Mapping[str, Hole | None], told: Words) -> Twist:
    """Return the CAD file with one of its holes another."""
    body = good.part.build({hole.id: hole}, sag_mm=NOMINAL_SAG_MM)
    others = [w for w in good.truth["holes"] if w["id"] != hole.id]
    words = _hole_words(hole, kept[hole.id])
    return Twist(body, told | {"holes": [*others, words]})


def hole_missing(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file has a hole more, drilled into a free place."""
    d = float(rng.choice([3.0, 4.0, 5.0, 6.0, 8.0]))
    p, n = plane_spot(good, rng, d / 2 + AROUND_MM)
    depth, is_through = _metal_below(good.body, p, n, d, float(rng.uniform(0.8, 2.0)) * d)
    hole = Hole("added", p, p - depth * n, d, is_through)
    told = told_words(p, d, [hole.id], hole_d=d, depth=depth)
    return Twist(
        good.body - bore(hole, NOMINAL_SAG_MM),
        told | {"holes": [*good.truth["holes"], _hole_words(hole, None)]},
    )


def _metal_below(body: Body, p: Array, n: Array, d: float, depth: float) -> tuple[float, bool]:
    """Return how deep a new hole goes, and whether through; metal is all round it."""
    wide = d + 2 * AROUND_MM
    long = float(np.linalg.norm(extents(body)))
    inside = rod(p - long * n, p - 0.01 * n, 0.2, NOMINAL_SAG_MM) ^ body
    pieces = [triangles_of(b).reshape(-1, 3) for b in inside.decompose()]
    tops = [(p - points) @ n for points in pieces]
    thick = min((t.max() for t in tops if t.min() < 0.3), default=0.0)
    beyond = rod(p - (thick + 0.4) * n, p - (thick + 0.05) * n, wide, NOMINAL_SAG_MM)
    if thick <= 15.0 and (beyond ^ body).volume() < 1e-3:
        depth, is_through = thick, True
    else:
        depth, is_through = min(depth, 0.6 * thick), False
    round_about = rod(p - (depth - 0.05) * n, p - 0.05 * n, wide, NOMINAL_SAG_MM)
    if depth < 2.0 or (round_about - body).volume() > 1e-3 * round_about.volume():
        raise NoPlaceError("no metal for a hole")
    return depth, is_through


def hole_extra(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file lacks a hole that the part has."""
    hole: Hole = pick(good.part.holes, rng)
    along = [(hole.mouth_mm - s * hole.depth_mm * hole.axis).tolist() for s in np.linspace(0, 1, 9)]
    told = told_words(hole.mouth_mm, hole.diameter_mm, [], hole_d=hole.diameter_mm)
    told |= {"places_mm": along}
    others = [w for w in good.truth["holes"] if w["id"] != hole.id]
    body = good.part.build({hole.id: None}, sag_mm=NOMINAL_SAG_MM)
    return Twist(body, told | {"holes": others})


def hole_position(good: Good, rng: np.random.Generator) -> Twist:
    hole: Hole = pick(good.part.holes, rng)
    now = good.holes[hole.id]
    drawn_at = hole.moved(float(rng.choice(SHIFTS_MM)) * across(hole, rng))
    off = now.mouth_mm - drawn_at.mouth_mm
    off -= (off @ hole.axis) * hole.axis
    if np.linalg.norm(off) < limit_mm(good) + BEYOND_MM:
        raise NoPlaceError("within the limit")
    size = float(np.linalg.norm(off))
    told = told_words(drawn_at.mouth_mm, size, [hole.id], shift_mm=off)
    return _with_hole(good, drawn_at, good.holes, told)


def _resized(good: Good, rng: np.random.Generator, sign: float) -> Twist:
    hole: Hole = pick(good.part.holes, rng)
    d = hole.diameter_mm - sign * float(rng.choice(RESIZES_MM))
    by = good.holes[hole.id].diameter_mm - d
    if d < 2.0 or sign * by < tolerance_mm(d) + BEYOND_MM:
        raise NoPlaceError("within the limit")
    told = told_words(hole.mouth_mm, abs(by), [hole.id], nominal_d=d, by=by)
    return _with_hole(good, replace(hole, diameter_mm=d), good.holes, told)


def hole_small(good: Good, rng: np.random.Generator) -> Twist:
    return _resized(good, rng, -1.0)


def hole_large(good: Good, rng: np.random.Generator) -> Twist:
    return _resized(good, rng, 1.0)


def hole_half_deep(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file's blind hole is deeper than the part's, or goes through."""
    hole: Hole = pick([h for h in good.part.holes if not h.is_through], rng)
    depth = hole.depth_mm * float(rng.uniform(1.6, 2.2))
    at = hole.bottom_mm - 0.02 * hole.axis
    depth, is_through = _metal_below(good.body, at, hole.axis, hole.diameter_mm - 2 * AROUND_MM,
                                     depth - hole.depth_mm)  # fmt: skip
    deeper = replace(
        hole, bottom_mm=hole.bottom_mm - (depth + 0.02) * hole.axis, is_through=is_through
    )
    told = told_words(hole.bottom_mm, hole.diameter_mm, [hole.id], depth=deeper.depth_mm)
    return _with_hole(good, deeper, good.holes, told)


def hole_depth_off(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file's blind hole is deeper or shallower than the part's by 20 to 40 %."""
    hole: Hole = pick([h for h in good.part.holes if not h.is_through], rng)
    share = float(rng.uniform(0.6, 0.8) if rng.random() < 0.5 else rng.uniform(1.2, 1.4))
    other = replace(hole, bottom_mm=hole.mouth_mm - share * hole.depth_mm * hole.axis)
    beyond = rod(other.bottom_mm - 0.5 * hole.axis, other.bottom_mm, hole.diameter_mm, 0.02)
    if share > 1 and (beyond - good.body).volume() > 1e-3:
        raise NoPlaceError("it would go through")
    if abs(share - 1) * hole.depth_mm < tolerance_mm(share * hole.depth_mm) + AS_BUILT_MM:
        raise NoPlaceError("within the limit")
    told = told_words(hole.bottom_mm, hole.diameter_mm, [hole.id], depth=other.depth_mm)
    return _with_hole(good, other, good.holes, told)


def hole_too_deep(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file's hole ends half way; the part's goes on, or through."""
    hole: Hole = pick([h for h in good.part.holes if h.depth_mm >= 4], rng)
    bottom = hole.mouth_mm - float(rng.uniform(0.4, 0.6)) * hole.depth_mm * hole.axis
    shallow = replace(hole, bottom_mm=bottom, is_through=False)
    told = told_words(bottom, hole.diameter_mm, [hole.id], depth=shallow.depth_mm)
    # the whole hole of the part is its place
    told |= {"places_mm": [hole.mouth_mm.tolist(), hole.bottom_mm.tolist()]}
    return _with_hole(good, shallow, good.holes, told)
