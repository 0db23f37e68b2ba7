"""CAD files changed so that a good specimen has a known defect against them.

The pictures stay; what they are judged by is twisted. A hole more in the CAD file is a hole missing
on the part, a boss less is a boss too many. Every kind draws from a generator, so that one good
specimen gives many defects, at a judgement's cost and without a tracer.

A size counts as wrong only where the specimen *as built*, not as drawn, is beyond the widest limit
that ISO 2768-m gives lengths of the part's size. Millimetres, CAD frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trace_held import FILES
from trace_held_defects import (
    Built,
    NoPlaceError,
    Rim,
    across,
    free_spot,
    mesh_of,
    pick,
    straight_edges,
    told_words,
    tolerance_mm,
)
from trace_held_defects import face_off as face_moved
from trace_held_parts import (
    FAMILIES,
    NOMINAL_SAG_MM,
    HeldPart,
    Hole,
    block,
    bore,
    drawn,
    frame,
    placed,
    prism,
    read_held_part,
    rod,
    triangles_of,
)

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid
Words = dict[str, Any]

SHIFTS_MM = (0.35, 0.4, 0.5, 0.7, 1.0)
RESIZES_MM = (0.3, 0.4, 0.5, 0.7, 1.0)
FACES_MM = (0.5, 0.7, 1.0)
CHAMFERS_MM = (1.0, 1.5, 2.0)
BEYOND_MM = 0.02  # beyond the limit, so that no reading of the limit calls it right
AROUND_MM = 0.6  # of metal round a new hole, of plane surface round a new boss
SAME_SHARE = 0.002  # of the volume; solids that differ by less are the same
SAME_MOMENT = 0.03  # moments of inertia that differ by less leave the axes open
TURN_STEP_DEG = 5.0  # where axes are open; the best turns are refined
SIZE_SHARE = 0.2  # by which boxes of parts of about the same size differ
TRY_COUNT = 40


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


# ------------------------------------------------------------------ holes


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


def limit_mm(good: Good) -> float:
    """Return the widest limit of a place on this part: that of its longest diagonal."""
    return tolerance_mm(float(np.linalg.norm(_extents(good.body))))


def hole_missing(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file has a hole more, drilled into a free place."""
    d = float(rng.choice([3.0, 4.0, 5.0, 6.0, 8.0]))
    p, n = _plane_spot(good, rng, d / 2 + AROUND_MM)
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
    long = float(np.linalg.norm(_extents(body)))
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


def hole_too_deep(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file's hole ends half way; the part's goes on, or through."""
    hole: Hole = pick([h for h in good.part.holes if h.depth_mm >= 4], rng)
    bottom = hole.mouth_mm - float(rng.uniform(0.4, 0.6)) * hole.depth_mm * hole.axis
    shallow = replace(hole, bottom_mm=bottom, is_through=False)
    told = told_words(bottom, hole.diameter_mm, [hole.id], depth=shallow.depth_mm)
    # the whole hole of the part is its place
    told |= {"places_mm": [hole.mouth_mm.tolist(), hole.bottom_mm.tolist()]}
    return _with_hole(good, shallow, good.holes, told)


# ------------------------------------------------------------------ bosses and ribs


def _plane_spot(good: Good, rng: np.random.Generator, radius_mm: float) -> tuple[Array, Array]:
    as_drawn = Built(good.body, {}, {}, good.body)
    return free_spot(as_drawn, rng, radius_mm, plane=True)


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
    p, n = _plane_spot(good, rng, d / 2 + AROUND_MM)
    new = rod(p - 0.1 * n, p + high * n, d, NOMINAL_SAG_MM)
    return _added(good, new, p, n, told_words(p + high / 2 * n, max(d, high), [], d=d, high=high))


def rib_missing(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file has a rib more."""
    long, wide, high = rng.uniform(8, 16), rng.uniform(2, 4), rng.uniform(3, 7)
    p, n = _plane_spot(good, rng, long / 2 + AROUND_MM)
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


# ------------------------------------------------------------------ faces and edges


def face_off(good: Good, rng: np.random.Generator) -> Twist:
    """An outer face of the CAD file is moved: on the part it is off by as much."""
    drawn_at = face_moved(good.part, Built(good.body, {}, {}, good.body), rng)
    by = -float(drawn_at.truth["dims"]["off_mm"])  # of the part
    n = np.array(drawn_at.truth["faces"][0]["normal"])
    about, scale = np.array(good.truth["scale_about"]), np.array(good.truth["scale"])
    place = np.array(drawn_at.truth["place_mm"])
    built = float((scale * (place - about) + about - place) @ n)
    if abs(by + built) < tolerance_mm(float(np.abs(_extents(drawn_at.body) @ n))) + BEYOND_MM:
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


# ------------------------------------------------------------------ whole parts


def _extents(body: Body) -> Array:
    return np.asarray(np.ptp(np.array(body.bounding_box()).reshape(2, 3), axis=0))


def _middle(body: Body) -> Array:
    return np.asarray(np.array(body.bounding_box()).reshape(2, 3).mean(axis=0))


def mirrored(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file is mirrored across a plane through the middle of its box.

    Raises
    ------
    NoPlaceError : the part is its own mirror image, turned or not
    """
    c, n = _middle(good.body), np.eye(3)[int(rng.integers(3))]
    body = good.body.translate(-c).mirror(n.tolist()).translate(c)
    if not is_handed(good.part.name):
        raise NoPlaceError("its own mirror image, or that turned")
    size = float(_extents(body).max())
    return Twist(body, told_words(c, size, [], across=n) | {"holes": []})


@lru_cache(maxsize=64)
def is_handed(name: str) -> bool:
    """Whether a part is another one in the mirror: no turn lays its mirror image on it.

    Mirror images across different planes are the same solid, turned; one of them decides for all.
    """
    body = part_of(name).build(sag_mm=NOMINAL_SAG_MM)
    return not is_turned(body.mirror([1.0, 0.0, 0.0]), body)


def is_turned(body: Body, other: Body, share: float = SAME_SHARE) -> bool:
    """Whether any turn and shift makes one solid of another, by what is left over of them.

    Centres of mass and principal axes are laid on each other, in all four ways of it. Where two
    moments of inertia are alike, their axes are open: then every turn about the third axis is
    tried, step by step, and the best one refined. With three alike, all turns of a cube.

    Parameters
    ----------
    body, other : solids
    share : of the volume of `other`; less than that left over is the same
    """
    first, second = _principal(body), _principal(other)
    if abs(body.volume() / other.volume() - 1) > share:
        return False
    limit = share * other.volume()

    def left(R: Array) -> float:
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = second[0] - R @ first[0]
        return 2 * float((placed(body, T) - other).volume())  # volumes are alike

    near = 50 * limit  # a turn that leaves more is not the right one, refined or not
    return any(
        now < limit or (now < near and _refined(left, R) < limit)
        for R in _turns(first, second, left)
        for now in (left(R),)
    )


def _principal(body: Body) -> tuple[Array, Array, Array]:
    """Return centre of mass, principal moments in rising order, axes as columns."""
    mesh = mesh_of(body)
    moments, axes = np.linalg.eigh(mesh.moment_inertia)
    return np.asarray(mesh.center_mass), moments, axes


def _turns(
    first: tuple[Array, Array, Array], second: tuple[Array, Array, Array],
    left: Callable[[Array], float],
) -> list[Array]:  # fmt: skip
    """Return the rotations that may lay the first solid on the second."""
    if np.abs(first[1] / second[1] - 1).max() > SAME_MOMENT:
        return []
    flips = [np.diag([a, b, c]) for a in (1, -1) for b in (1, -1) for c in (1, -1)]
    m = second[1]
    alike = [bool(m[1] / m[0] - 1 < SAME_MOMENT), bool(m[2] / m[1] - 1 < SAME_MOMENT)]
    laid = [second[2] @ f @ first[2].T for f in flips]
    laid = [R for R in laid if np.linalg.det(R) > 0]
    if not any(alike):
        return laid
    if all(alike):
        cube = [np.eye(3)[list(p)] @ f for p in _ORDERS for f in flips]
        return [R for R in (second[2] @ C @ first[2].T for C in cube) if np.linalg.det(R) > 0]
    axis = second[2][:, 2 if alike[0] else 0]
    out = []
    for R in laid:
        angles = np.arange(0, 360, TURN_STEP_DEG)
        scores = [left(_about(axis, a) @ R) for a in angles]
        # the best few of the coarse turns, each refined later
        out += [_about(axis, angles[i]) @ R for i in np.argsort(scores)[:4]]
    return out


_ORDERS = ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2))


def _about(axis: Array, degrees: float) -> Array:
    T = trimesh.transformations.rotation_matrix(np.radians(degrees), axis)
    return np.asarray(T[:3, :3])


def _refined(left: Callable[[Array], float], R: Array) -> float:
    """Return what is left over at the best turn near another one."""
    best = left(R)
    for step in (2.0, 0.8, 0.3, 0.1):
        for axis in np.eye(3):
            for sign in (-1, 1):
                while (now := left(_about(axis, sign * step) @ R)) < best - 1e-9:
                    best, R = now, _about(axis, sign * step) @ R
    return best


def wrong_revision(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file is of another revision of the same family: every size a little different."""
    family, _, number = good.part.name.rpartition("_")
    if family not in FAMILIES:
        raise NoPlaceError("no other revision")
    for _ in range(TRY_COUNT):
        other = drawn(family, int(number) + int(rng.integers(1, 1_000_000)) * 10_000)
        body = other.build(sag_mm=NOMINAL_SAG_MM)
        if np.abs(_extents(body) / _extents(good.body) - 1).max() < SIZE_SHARE / 2:
            return _other(good, body, other.name)
    raise NoPlaceError("no revision of about the same size")


def wrong_part(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file is of another part of the folder, of about the same size."""
    sizes = _extents(good.body)
    fits = []
    for name, body in sorted(good.others.items()):
        extents = _extents(body)
        R = np.zeros((3, 3))
        R[np.argsort(sizes), np.argsort(extents)] = 1.0
        R[:, 0] *= np.linalg.det(R)  # no mirror image
        off = np.sort(extents) / np.sort(sizes) - 1
        if name != good.part.name and np.abs(off).max() < SIZE_SHARE:
            T = np.eye(4)
            T[:3, :3] = R
            fits.append((name, placed(body, T)))
    name, body = pick(fits, rng)
    return _other(good, body, name)


def _other(good: Good, body: Body, name: str) -> Twist:
    body = body.translate(_middle(good.body) - _middle(body))
    same = (body - good.body).volume() + (good.body - body).volume()
    if same < 0.02 * good.body.volume():
        raise NoPlaceError("too much alike")
    size = float(_extents(body).max())
    return Twist(body, told_words(_middle(body), size, []) | {"holes": [], "other": name})


KINDS: dict[str, Callable[[Good, np.random.Generator], Twist]] = {
    f.__name__: f
    for f in (
        hole_missing, hole_extra, hole_position, hole_small, hole_large, hole_half_deep,
        hole_too_deep, boss_missing, rib_missing, boss_extra, face_off, chamfer_missing,
        mirrored, wrong_revision, wrong_part,
    )
}  # fmt: skip
