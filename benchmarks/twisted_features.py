"""CAD files with other bosses, ribs, slots, pockets, faces or edges than a good specimen has."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trace_held_defects import (
    Built,
    NoPlaceError,
    Rim,
    pick,
    straight_edges,
    told_words,
    tolerance_mm,
)
from trace_held_defects import face_off as face_moved
from trace_held_parts import NOMINAL_SAG_MM, Step, block, frame, placed, prism, rod
from twisted_good import AROUND_MM, BEYOND_MM, Good, Twist, extents, plane_spot

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid
Words = dict[str, Any]

CHAMFERS_MM = (1.0, 1.5, 2.0)
CUTS_MM = (0.5, 0.7, 1.0)
NOTCHES_MM = (1.6, 2.0, 3.0)


# ------------------------------------------------------------------ bosses and ribs


def _added(good: Good, new: Body, low: Array, n: Array, told: Words) -> Twist:
    """Return the CAD file with a body more, which stands on a free place in free air."""
    above = new.translate(AROUND_MM * n)
    if (above ^ good.body).volume() > 1e-3 * new.volume() + 0.02:
        raise NoPlaceError("it would touch another wall")
    for T, half in good.boxes:
        if not (placed(block(-half - AROUND_MM, half + AROUND_MM), T) ^ new).is_empty():
            raise NoPlaceError("the gripper is there")
    return Twist(good.body + new, told)


def boss_missing(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file has a boss more."""
    d, high = float(rng.choice([6.0, 8.0, 10.0])), float(rng.uniform(3, 7))
    p, n = plane_spot(good, rng, d / 2 + AROUND_MM)
    new = rod(p - 0.1 * n, p + high * n, d, NOMINAL_SAG_MM)
    return _added(good, new, p, n, told_words(p + high / 2 * n, max(d, high), [], d=d, high=high))


def rib_missing(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file has a rib more."""
    long, wide, high = rng.uniform(8, 16), rng.uniform(2, 4), rng.uniform(3, 7)
    p, n = plane_spot(good, rng, long / 2 + AROUND_MM)
    T = frame(n, p)
    half = np.array([long, wide] if rng.random() < 0.5 else [wide, long]) / 2
    new = placed(block([*-half, -0.1], [*half, high]), T)
    told = told_words(p + high / 2 * n, long, [], long=long, wide=wide, high=high)
    return _added(good, new, p, n, told)


def boss_extra(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file lacks a boss or a rib that the part has."""
    step = pick([s for s in good.part.steps if s.name], rng)
    body = good.part.build(without=(step.name,), sag_mm=NOMINAL_SAG_MM)
    return Twist(body, told_words(step.place_mm, step.size_mm, []))


# ------------------------------------------------------------------ slots, pockets, keyways


def _cut_changed(good: Good, step: Step, other: Step | None, shift_mm: Array) -> Twist:
    """Return the CAD file with one of its cuts another, or left out."""
    part = good.part
    steps = [other if s is step else s for s in part.steps]
    body = replace(part, steps=tuple(s for s in steps if s is not None)).build(
        sag_mm=NOMINAL_SAG_MM
    )
    changed = (body - good.body) + (good.body - body)
    if changed.volume() < 0.1:
        raise NoPlaceError("nothing changed")
    low, high = np.array(changed.bounding_box()).reshape(2, 3)
    size = float((high - low).max())
    return Twist(body, told_words((low + high) / 2, size, [], shift_mm=shift_mm))


def cut_extra(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file lacks a slot, a pocket, a keyway or a flat that the part has."""
    return _cut_changed(
        good, pick([s for s in good.part.steps if not s.adds], rng), None, np.zeros(3)
    )


def cut_moved(good: Good, rng: np.random.Generator) -> Twist:
    """A slot, a pocket, a keyway or a flat is elsewhere in the CAD file, or its floor is."""
    step: Step = pick([s for s in good.part.steps if not s.adds], rng)
    by = float(rng.choice(CUTS_MM)) * float(rng.choice([-1.0, 1.0])) * np.eye(3)[rng.integers(3)]
    other = replace(step, make=lambda sag: step.make(sag).translate(by))
    return _cut_changed(good, step, other, by)


# ------------------------------------------------------------------ faces and edges


def face_off(good: Good, rng: np.random.Generator) -> Twist:
    """An outer face of the CAD file is moved: on the part it is off by as much."""
    drawn_at = face_moved(good.part, Built(good.body, {}, {}, good.body), rng)
    by = -float(drawn_at.truth["dims"]["off_mm"])  # of the part
    n = np.array(drawn_at.truth["faces"][0]["normal"])
    about, scale = np.array(good.truth["scale_about"]), np.array(good.truth["scale"])
    place = np.array(drawn_at.truth["place_mm"])
    built = float((scale * (place - about) + about - place) @ n)
    if abs(by + built) < tolerance_mm(float(np.abs(extents(drawn_at.body) @ n))) + BEYOND_MM:
        raise NoPlaceError("within the limit")
    return Twist(drawn_at.body, drawn_at.truth | {"dims": {"off_mm": by}})


def chamfer_missing(good: Good, rng: np.random.Generator) -> Twist:
    """An edge of the CAD file is broken by 1 to 2 mm; the part's is sharp."""
    leg = float(rng.choice(CHAMFERS_MM))
    rim: Rim = pick(straight_edges(good.body, 8.0), rng)
    a, b = rim.normals
    inward = [-(v - (v @ w) * w) for v, w in ((b, a), (a, b))]
    legs = [leg * v / np.linalg.norm(v) for v in inward]
    T = np.eye(4)
    T[:3, 2], T[:3, 3] = rim.along, rim.start_mm
    T[:3, 0] = legs[0] / leg
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    over = -0.05 * (legs[0] + legs[1]) / leg  # cut from just outside
    corners = [(v @ T[:3, :2]).tolist() for v in (over, legs[0] + over / 9, legs[1] + over / 9)]
    tool = prism(corners, rim.length_mm, T)
    if (good.body ^ tool).volume() < 0.4 * leg**2 * rim.length_mm * np.linalg.norm(np.cross(a, b)):
        raise NoPlaceError("the edge is another's")
    middle = rim.start_mm + 0.5 * rim.length_mm * rim.along
    told = told_words(middle, leg, rim.faces(middle), leg=leg, length=rim.length_mm)
    ends = np.linspace(0, 1, 15)[:, None] * rim.length_mm * rim.along + rim.start_mm
    return Twist(good.body - tool, told | {"places_mm": ends.tolist()})


def notch_missing(good: Good, rng: np.random.Generator) -> Twist:
    """An edge of the CAD file has a small round notch; the part's goes through."""
    wide = float(rng.choice(NOTCHES_MM))
    rim: Rim = pick(straight_edges(good.body, 3 * wide), rng)
    at = rim.start_mm + rim.along * rng.uniform(1.2 * wide, rim.length_mm - 1.2 * wide)
    inward = -rim.normals.sum(axis=0) / np.linalg.norm(rim.normals.sum(axis=0))
    tool = rod(at - wide * inward, at + 0.35 * wide * inward, wide, 0.01)
    if (good.body ^ tool).volume() < 0.03 * wide**3:
        raise NoPlaceError("nothing there")
    told = told_words(at, wide, rim.faces(at), wide=wide)
    return Twist(good.body - tool, told)
