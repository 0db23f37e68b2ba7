"""What is wrong with a specimen, or right within tolerance: changes to a part, with their truth.

Every change is made on the solid with sizes that are drawn, so truth is what was drawn. Sizes are
on ladders from what a camera of 0.2 mm a pixel can just tell to what nobody should miss.
Millimetres, CAD frame of the nominal part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray
from trace_held_light import Stain
from trace_held_parts import (
    HeldPart,
    Hole,
    block,
    drawn,
    frame,
    placed,
    prism,
    rod,
    triangles_of,
)

Array = NDArray[np.float64]
Body = Any
Words = dict[str, Any]
Item = TypeVar("Item")

# ISO 2768-1 class m, permissible deviations of lengths: up to, plus or minus [mm]
ISO_2768_M = ((3.0, 0.1), (6.0, 0.1), (30.0, 0.2), (120.0, 0.3), (400.0, 0.5))
AS_BUILT_SHARE = 0.3  # of the tolerance is used up by a good part
AS_BUILT_MM = 0.05  # a good part's lengths are off by this at most
MAX_TRIES = 60


class NoPlaceError(Exception):
    """The part has no place for such a defect."""


@dataclass(frozen=True, eq=False)
class Built:
    """A specimen as it is.

    Attributes
    ----------
    body : as traced, before its scale
    holes : as they are, before the scale; None: not there
    truth : kind, place, size and faces, as truth.json has them
    sound : the same specimen without its defect
    stain : on it
    scale, about_mm : X = scale (X_cad - about) + about
    """

    body: Body
    holes: dict[str, Hole | None]
    truth: Words
    sound: Body
    stain: Stain | None = None
    scale: Array = field(default_factory=lambda: np.ones(3))
    about_mm: Array = field(default_factory=lambda: np.zeros(3))

    def scaled(self, points: Array) -> Array:
        """Return points (n, 3) of the body as they are, its scale applied [mm]."""
        out: Array = self.scale * (points - self.about_mm) + self.about_mm
        return out


def tolerance_mm(length_mm: float) -> float:
    """Return the permissible deviation of ISO 2768-m."""
    return next(deviation for limit, deviation in ISO_2768_M if length_mm <= limit)


def perfect(part: HeldPart) -> Built:
    """Return the part exactly as drawn."""
    body = part.build()
    return Built(body, {h.id: h for h in part.holes}, {"kind": "perfect"}, body)


def as_built(part: HeldPart, rng: np.random.Generator) -> Built:
    """Return a good part: its lengths, diameters and places off within part of the tolerance."""
    low, high = np.array(part.build().bounding_box()).reshape(2, 3)
    scale = 1.0 + rng.uniform(-1, 1, 3) * AS_BUILT_MM / (high - low)
    holes: dict[str, Hole | None] = {}
    for hole in part.holes:
        limit = AS_BUILT_SHARE * tolerance_mm(hole.diameter_mm)
        moved = hole.moved(across(hole, rng) * rng.uniform(0, AS_BUILT_SHARE * 0.2))
        holes[hole.id] = replace(moved, diameter_mm=hole.diameter_mm + rng.uniform(-limit, limit))
    body = part.build(holes)
    return Built(body, holes, {"kind": "as_built"}, body, None, scale, (low + high) / 2)


def across(hole: Hole, rng: np.random.Generator) -> Array:
    """Return a unit vector square to a hole's axis."""
    T = frame(hole.axis, np.zeros(3))
    angle = rng.uniform(0, 2 * np.pi)
    out: Array = np.cos(angle) * T[:3, 0] + np.sin(angle) * T[:3, 1]
    return out


def with_defect(part: HeldPart, kind: str, rng: np.random.Generator) -> Built:
    """Return a part as built with one defect.

    Parameters
    ----------
    part : nominal
    kind : one of DEFECTS
    rng : draws place and size

    Raises
    ------
    NoPlaceError : this part cannot have it
    """
    good = as_built(part, rng)
    built = DEFECTS[kind](part, good, rng)
    if built.body.is_empty() or (abs((built.body - good.body).volume()) < 1e-3
                                 and abs((good.body - built.body).volume()) < 1e-3
                                 and built.stain is None):  # fmt: skip
        raise NoPlaceError(f"{part.name}: {kind} changes nothing")
    built.truth["kind"] = kind
    return built


def told_words(place: Array, size: float, faces: list[Any], **more: float | Array) -> Words:
    return {
        "place_mm": np.round(place, 4).tolist(),
        "size_mm": round(float(size), 4),
        "faces": faces,
        "dims": {k: np.round(v, 4).tolist() for k, v in more.items()},
    }


def pick(items: Sequence[Item], rng: np.random.Generator) -> Item:
    if not items:
        raise NoPlaceError("nothing to pick from")
    return items[int(rng.integers(len(items)))]


# ------------------------------------------------------------------ holes


def _rebuilt(part: HeldPart, good: Built, hole: Hole, now: Hole | None, truth: Words) -> Built:
    holes = good.holes | {hole.id: now}
    return replace(good, body=part.build(holes), holes=holes, truth=truth)


def _hole(part: HeldPart, good: Built, rng: np.random.Generator, **need: float) -> Hole:
    wide = [
        good.holes[h.id]
        for h in part.holes
        if h.diameter_mm >= need.get("diameter", 0) and h.depth_mm >= need.get("depth", 0)
    ]
    hole: Hole = pick(wide, rng)
    return hole


def hole_missing(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    hole = _hole(part, good, rng)
    truth = told_words(hole.mouth_mm, hole.diameter_mm, [hole.id], hole_d=hole.diameter_mm)
    return _rebuilt(part, good, hole, None, truth)


def hole_filled(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    """Swarf or weld in a hole: it ends flat somewhere below its mouth."""
    hole = _hole(part, good, rng, depth=4)
    d = hole.diameter_mm
    depth = rng.uniform(0.15, 0.45) * hole.depth_mm
    thick = min(rng.uniform(0.3, 0.5) * hole.depth_mm, hole.depth_mm - depth)
    top = hole.mouth_mm - depth * hole.axis
    plug = rod(top - thick * hole.axis, top, d + 0.1, 0.002)
    truth = told_words(top, d, [hole.id], below_mouth=depth, thickness=thick)
    return replace(good, body=good.body + plug, truth=truth)


def hole_half_deep(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    hole = _hole(part, good, rng, depth=4)
    share = rng.uniform(0.4, 0.6)
    bottom = hole.mouth_mm - share * hole.depth_mm * hole.axis
    now = replace(hole, bottom_mm=bottom, is_through=False)
    return _rebuilt(
        part, good, hole, now, told_words(bottom, hole.diameter_mm, [hole.id], depth=now.depth_mm)
    )


def hole_position(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    nominal = {h.id: h for h in part.holes}
    hole = nominal[_hole(part, good, rng).id]
    shift = float(rng.choice([0.4, 0.5, 0.7, 1.0, 1.5])) * across(hole, rng)
    now = replace(hole.moved(shift), diameter_mm=good.holes[hole.id].diameter_mm)  # type: ignore[union-attr]
    size = float(np.linalg.norm(shift))
    return _rebuilt(
        part, good, hole, now, told_words(now.mouth_mm, size, [hole.id], shift_mm=shift)
    )


def _hole_resized(part: HeldPart, good: Built, rng: np.random.Generator, sign: float) -> Built:
    nominal = {h.id: h for h in part.holes}
    hole = nominal[_hole(part, good, rng).id]
    beyond = float(rng.choice([0.15, 0.25, 0.4, 0.7]))
    by = sign * (tolerance_mm(hole.diameter_mm) + beyond)
    now = replace(good.holes[hole.id], diameter_mm=hole.diameter_mm + by)  # type: ignore[type-var]
    truth = told_words(hole.mouth_mm, abs(by), [hole.id], nominal_d=hole.diameter_mm,
                  true_d=hole.diameter_mm + by)  # fmt: skip
    return _rebuilt(part, good, hole, now, truth)


def hole_small(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    return _hole_resized(part, good, rng, -1.0)


def hole_large(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    return _hole_resized(part, good, rng, 1.0)


# ------------------------------------------------------------------ edges


@dataclass(frozen=True, eq=False)
class Rim:
    """A straight convex edge: its ends, and the normals of the faces that meet in it."""

    start_mm: Array
    end_mm: Array
    normals: Array

    @property
    def length_mm(self) -> float:
        return float(np.linalg.norm(self.end_mm - self.start_mm))

    @property
    def along(self) -> Array:
        return np.asarray((self.end_mm - self.start_mm) / self.length_mm)

    def faces(self, at: Array) -> list[Words]:
        return [{"normal": np.round(n, 4).tolist(), "point": np.round(at, 3).tolist()}
                for n in self.normals]  # fmt: skip


def mesh_of(body: Body) -> trimesh.Trimesh:
    triangles = triangles_of(body)
    return trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=True
    )


def straight_edges(body: Body, min_mm: float) -> list[Rim]:
    """Return the convex edges where faces meet at 50 to 130 degrees, longer than asked."""
    mesh = mesh_of(body)
    angle = mesh.face_adjacency_angles
    ok = (angle > np.radians(50)) & (angle < np.radians(130)) & mesh.face_adjacency_convex
    pairs, edges = mesh.face_adjacency[ok], mesh.face_adjacency_edges[ok]
    groups: dict[Any, list[tuple[Array, Array, Array]]] = {}
    for (i, j), (a, b) in zip(pairs, edges, strict=True):
        n = mesh.face_normals[[i, j]]
        n = n[np.lexsort(n.round(3).T)]
        p, q = mesh.vertices[a], mesh.vertices[b]
        d = np.cross(n[0], n[1])
        d /= np.linalg.norm(d)
        foot = p - (p @ d) * d
        key = (*n.round(3).ravel().tolist(), *foot.round(2).tolist())
        groups.setdefault(key, []).append((p @ d, q @ d, np.vstack([p, n, d[None]])))  # type: ignore[arg-type]
    out = []
    for members in groups.values():
        spans = sorted((min(a, b), max(a, b)) for a, b, _ in members)
        p, n, d = members[0][2][0], members[0][2][1:3], members[0][2][3]
        low, high = spans[0]
        runs = []
        for a, b in spans[1:]:
            if a <= high + 1e-3:
                high = max(high, b)
            else:
                runs.append((low, high))
                low, high = a, b
        runs.append((low, high))
        foot = p - (p @ d) * d
        out += [Rim(foot + a * d, foot + b * d, n) for a, b in runs if b - a >= min_mm]
    return out


def chip(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    length = float(rng.choice([1.2, 1.6, 2.0, 3.0]))
    rim: Rim = pick(straight_edges(good.body, 3 * length), rng)
    at = rim.start_mm + rim.along * rng.uniform(1.2 * length, rim.length_mm - 1.2 * length)
    inward = -(rim.normals[0] + rim.normals[1])
    inward /= np.linalg.norm(inward)
    # a broken edge is a few conchoidal flakes
    tool = Manifold()
    for share in (0.0, -0.22, 0.25):
        r = length * rng.uniform(0.5, 0.62) * (1.0 if share == 0 else 0.62)
        centre = at + share * length * rim.along - inward * r * rng.uniform(0.42, 0.55)
        tool = tool + Manifold.sphere(r, 40).translate(centre)
    removed = good.body ^ tool
    if removed.is_empty():
        raise NoPlaceError("nothing there")
    spread = triangles_of(removed).reshape(-1, 3)
    along = float(np.ptp(spread @ rim.along))
    deep = float(((spread - at) @ inward).max())
    truth = told_words(
        at, along, rim.faces(at), length=along, depth=deep, removed_mm3=removed.volume()
    )
    return replace(good, body=good.body - tool, truth=truth)


def burr(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    height = float(rng.choice([0.6, 0.8, 1.1, 1.5]))
    length = float(rng.uniform(4, 9))
    rim: Rim = pick(straight_edges(good.body, 1.4 * length), rng)
    at = rim.start_mm + rim.along * rng.uniform(0.7 * length, rim.length_mm - 0.7 * length)
    k = int(rng.integers(2))
    out, side = rim.normals[k], rim.normals[1 - k]  # it stands on one face, flush with the other
    thick = rng.uniform(0.15, 0.3)
    s = np.linspace(-length / 2, length / 2, 12)
    top = height * (1 - rng.uniform(0, 0.35, 12))
    top[int(rng.integers(3, 9))] = height
    top[[0, -1]] = 0.1 * height
    outline = np.vstack([np.column_stack([s, top]), [[length / 2, -0.1], [-length / 2, -0.1]]])
    T = np.eye(4)
    side = side - (side @ out) * out
    side /= np.linalg.norm(side)
    x = rim.along if np.cross(rim.along, out) @ side < 0 else -rim.along
    T[:3, :3] = np.column_stack([x, out, np.cross(x, out)])
    T[:3, 3] = at
    ridge = prism(outline, thick, T)  # type: ignore[arg-type]
    body = good.body + ridge
    place = at + height / 2 * out
    return replace(
        good,
        body=body,
        truth=told_words(
            place, height, rim.faces(at), height=height, length=length, thickness=thick
        ),
    )


# ------------------------------------------------------------------ surfaces


def free_spot(
    good: Built, rng: np.random.Generator, radius_mm: float, *, plane: bool
) -> tuple[Array, Array]:
    """Return a point of the surface and its normal, with such a surface round about."""
    mesh = mesh_of(good.body)
    rays = trimesh.ray.ray_pyembree.RayMeshIntersector(mesh)
    points, faces = trimesh.sample.sample_surface(mesh, MAX_TRIES, seed=int(rng.integers(2**31)))
    a = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    for p, i in zip(points, faces, strict=True):
        n = mesh.face_normals[i]
        T = frame(n, p)
        ring = p + radius_mm * (np.cos(a)[:, None] * T[:3, 0] + np.sin(a)[:, None] * T[:3, 1])
        low, _, _ = rays.intersects_location(
            ring + 3 * n, np.repeat(-n[None], 16, 0), multiple_hits=False
        )
        if len(low) < 16:
            continue
        off = np.abs((low - p) @ n)
        is_open = len(rays.intersects_location((p + 0.01 * n)[None], n[None])[0]) == 0
        limit = 0.005 if plane else 0.35 * radius_mm
        if off.max() < limit and is_open and (plane or off.max() > 0.02 or rng.random() < 0.7):
            return np.asarray(p), np.asarray(n)
    raise NoPlaceError("no free surface that large")


def _surface(p: Array, n: Array) -> list[Words]:
    return [{"normal": np.round(n, 4).tolist(), "point": np.round(p, 3).tolist()}]


def dent(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    width = float(rng.choice([1.6, 2.1, 2.6, 4.0]))
    depth = width * rng.uniform(0.1, 0.22)
    p, n = free_spot(good, rng, width * 0.8, plane=False)
    radius = (width**2 / 4 + depth**2) / (2 * depth)
    ball = Manifold.sphere(radius, 160).translate(p + (radius - depth) * n)
    truth = told_words(p, width, _surface(p, n), width=width, depth=depth)
    return replace(good, body=good.body - ball, truth=truth)


def pit(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    """A cast pore: as deep as wide, ragged."""
    width = float(rng.choice([1.0, 1.6, 2.2]))
    p, n = free_spot(good, rng, width * 0.8, plane=False)
    T = frame(n, p)
    tool = Manifold.sphere(width / 2, 48).translate(p - 0.1 * width * n)
    for _ in range(3):
        aside = T[:3, :2] @ rng.normal(0, 0.22 * width, 2)
        tool = tool + Manifold.sphere(width * 0.3, 32).translate(p - 0.2 * width * n + aside)
    truth = told_words(p, width, _surface(p, n), width=width, depth=0.6 * width)
    return replace(good, body=good.body - tool, truth=truth)


def scratch(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    width = float(rng.choice([0.4, 0.5, 0.7]))
    length = float(rng.uniform(6, 13))
    p, n = free_spot(good, rng, length / 2, plane=True)
    depth = width * rng.uniform(0.25, 0.4)
    T = frame(n, p)
    turn = rng.uniform(0, np.pi)
    x = np.cos(turn) * T[:3, 0] + np.sin(turn) * T[:3, 1]
    T[:3, :3] = np.column_stack([np.cross(n, x), n, np.cross(np.cross(n, x), n)])
    T[:3, 3] = p - length / 2 * T[:3, 2]
    over = 0.2
    half = width / 2 * (depth + over) / depth
    tool = prism([[0, -depth], [half, over], [-half, over]], length, T)
    truth = told_words(p, length, _surface(p, n), width=width, depth=depth, length=length)
    return replace(good, body=good.body - tool, truth=truth)


def stain(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    size = float(rng.choice([4.0, 6.0, 8.0, 11.0]))
    p, n = free_spot(good, rng, size * 0.4, plane=False)
    T = frame(n, p)
    k = 7
    centres = p + (T[:3, :2] @ rng.normal(0, 0.17 * size, (2, k))).T
    radii = size * rng.uniform(0.15, 0.33, k)
    factor = float(rng.choice([0.35, 0.5, 0.65]))
    truth = told_words(p, size, _surface(p, n), factor=factor)
    return replace(good, stain=Stain(centres, radii, factor), truth=truth)


# ------------------------------------------------------------------ whole features


def _left_out(
    part: HeldPart, good: Built, rng: np.random.Generator, words: tuple[str, ...]
) -> Built:
    step = pick([s for s in part.steps if s.name.startswith(words)], rng)
    body = part.build(good.holes, (step.name,))
    truth = told_words(step.place_mm, step.size_mm, [step.name])
    return replace(good, body=body, truth=truth)


def boss_missing(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    return _left_out(part, good, rng, ("boss",))


def rib_missing(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    return _left_out(part, good, rng, ("rib", "cheek"))


def face_off(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    """An outer face is 0.5 mm or more too low or too high."""
    mesh = mesh_of(good.body)
    by = float(rng.choice([0.5, 0.5, 0.7, 1.0])) * float(rng.choice([-1.0, 1.0]))
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            n = sign * np.eye(3)[axis]
            top = (mesh.vertices @ n).max()
            on = (mesh.face_normals @ n > 0.9999) & ((mesh.triangles_center @ n) > top - 1e-3)
            if mesh.area_faces[on].sum() > 60:
                sides.append((n, float(top), on))
    n, top, on = pick(sides, rng)
    low, high = mesh.bounds
    half = float((high - low).max())
    place = np.average(mesh.triangles_center[on], axis=0, weights=mesh.area_faces[on])
    T = frame(n, (low + high) / 2 + (top - (low + high) / 2 @ n) * n)
    slab = placed(block((-half, -half, -abs(by)), (half, half, 2.0)), T)
    raised = good.body + (good.body ^ slab).translate(by * n)
    body = good.body - slab if by < 0 else raised
    truth = told_words(place, abs(by), _surface(place, n), off_mm=by)
    holes = dict(good.holes)
    return replace(good, body=body, truth=truth, holes=holes)


def mirrored(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    low, high = np.array(good.body.bounding_box()).reshape(2, 3)
    c = (low + high) / 2
    axis = int(rng.integers(3))
    n = np.eye(3)[axis]
    body = good.body.translate(-c).mirror(n.tolist()).translate(c)
    drawn_body = part.build()
    if is_turned(drawn_body.translate(-c).mirror(n.tolist()).translate(c), drawn_body):
        raise NoPlaceError("its own mirror image, or that turned")
    truth = told_words(c, float(np.ptp([low, high])), [], across=n)
    return replace(good, body=body, truth=truth, holes={})


def is_turned(body: Body, other: Body) -> bool:
    """Whether none or a half turn about an axis of the box makes one solid of the other."""
    low, high = np.array(other.bounding_box()).reshape(2, 3)
    c = (low + high) / 2
    limit = 0.002 * other.volume()
    for turn in ((0, 0, 0), (180, 0, 0), (0, 180, 0), (0, 0, 180)):
        turned = body.translate(-c).rotate(turn).translate(c)
        if (turned - other).volume() + (other - turned).volume() < limit:
            return True
    return False


def wrong_part(part: HeldPart, good: Built, rng: np.random.Generator) -> Built:
    """Another revision of the same family: every size a little different."""
    family, _, seed = part.name.rpartition("_")
    if part.path is not None or not seed.isdigit():
        raise NoPlaceError("no other revision")
    other = drawn(family, int(seed) + 7_000_000)
    body = other.build()
    low, high = np.array(body.bounding_box()).reshape(2, 3)
    truth = told_words((low + high) / 2, float((high - low).max()), [])
    return replace(good, body=body, truth=truth, holes={})


DEFECTS: dict[str, Callable[[HeldPart, Built, np.random.Generator], Built]] = {
    f.__name__: f
    for f in (
        hole_missing, hole_position, chip, dent, hole_small, burr, scratch, hole_half_deep, stain,
        face_off, pit, boss_missing, hole_large, mirrored, hole_filled, rib_missing, wrong_part,
    )
}  # fmt: skip
