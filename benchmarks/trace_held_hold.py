"""How a part is held and shown: grasps of two fingers, views that together show its surface.

Everything here is in the part's frame until a view has its pose: fingers, what they hide and
what the camera sees. Nothing of the project's own planning is used. Millimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trace_held_light import Sight
from trace_held_parts import frame

Array = NDArray[np.float64]
Words = dict[str, Any]
Rays = Any  # trimesh's intersector

MAX_OPENING_MM = 80.0
ASIDE = 8  # ways to come from, round the closing direction
SAMPLES = 700
MARGIN_PX = 14.0
SEEN_COS = 0.3
SQUARE = 1.35  # looks nearly along an axis of the part are wanted so much more: they measure


class NoHoldError(Exception):
    """No grasp, or no view, was found."""


@dataclass(frozen=True, eq=False)
class Box:
    """A box in the part's frame: pose of its middle and half sizes."""

    T: Array
    half_mm: Array

    def triangles_mm(self) -> Array:
        """Return its triangles (12, 3, 3) in its own frame."""
        return np.asarray(trimesh.creation.box(2 * self.half_mm).triangles, np.float64)


@dataclass(frozen=True, eq=False)
class Grasp:
    """A hold.

    Attributes
    ----------
    boxes : two fingers, then the palm
    closing, approach : (3,) unit
    width_mm : between the fingers
    contact_mm2 : smaller of the two pads' contact
    """

    boxes: tuple[Box, ...]
    closing: Array
    approach: Array
    width_mm: float
    contact_mm2: float


@dataclass(frozen=True, eq=False)
class View:
    """One look: the grasp's number and the pose of the part in the station."""

    grasp: int
    T: Array


def find_grasps(body: trimesh.Trimesh, hand: Words, rng: np.random.Generator) -> list[Grasp]:
    """Return two grasps that differ.

    Parameters
    ----------
    body : the part as it is
    hand : sizes of fingers and palm, as in truth.json
    rng : draws

    Raises
    ------
    NoHoldError : fewer than two were found
    """
    rays = trimesh.ray.ray_pyembree.RayMeshIntersector(body)
    seed = int(rng.integers(2**31))
    points, faces = trimesh.sample.sample_surface(body, 400, seed=seed)
    cloud, _ = trimesh.sample.sample_surface(body, 6000, seed=seed + 1)
    cloud = np.vstack([cloud, body.vertices])
    found: list[tuple[float, Grasp, Array]] = []
    for p, face in zip(points, faces, strict=True):
        n = body.face_normals[face]
        hits, _, which = rays.intersects_location((p + 200 * n)[None], -n[None], multiple_hits=True)
        if len(hits) < 2:
            continue
        along = (hits - p) @ n
        if along.max() > 0.01:
            continue  # something stands before it
        last = int(np.argmin(along))
        width = -float(along[last])
        if not 5.0 < width < MAX_OPENING_MM or body.face_normals[which[last]] @ n > -0.998:
            continue
        turned = frame(n, p)
        for k in range(ASIDE):
            angle = 2 * np.pi * k / ASIDE + (0.0 if k % 2 == 0 else rng.uniform(-0.3, 0.3))
            approach = np.cos(angle) * turned[:3, 0] + np.sin(angle) * turned[:3, 1]
            grasp = _grasp(rays, cloud, p, n, approach, width, hand)
            if grasp is not None:
                straight = 1.0 + float(np.abs(approach).max() > 0.999)
                found.append((grasp.contact_mm2 * straight * rng.uniform(0.6, 1.0), grasp, p))
        if len(found) > 60:
            break
    if not found:
        raise NoHoldError("no grasp")
    found.sort(key=lambda one: -one[0])
    first = found[0]
    others = [
        one
        for one in found
        if np.linalg.norm(one[2] - first[2]) > 18 or one[1].approach @ first[1].approach < 0.5
    ]
    if not others:
        raise NoHoldError("one grasp only")
    return [first[1], others[0][1]]


def hold_at(body: trimesh.Trimesh, p: Array, approach: Array, hand: Words) -> Grasp:
    """Return the hold of a flat body between its upper and its lower side.

    Parameters
    ----------
    body : the part as it is
    p : (3,) on its upper side
    approach : (3,) unit, the way the fingers reach
    hand : as `find_grasps` has it

    Raises
    ------
    NoHoldError : the hand does not fit there
    """
    up = np.array([0.0, 0.0, 1.0])
    rays = trimesh.ray.ray_pyembree.RayMeshIntersector(body)
    width = float(np.ptp(body.bounds[:, 2]))
    grasp = _grasp(rays, body.vertices, p, up, approach, width, hand)
    if grasp is None:
        raise NoHoldError("the hand does not fit there")
    return grasp


def _grasp(
    rays: Rays, cloud: Array, p: Array, n: Array, approach: Array, width: float, hand: Words
) -> Grasp | None:
    """Return the hold at a point, or None where the hand does not fit or hardly touches."""
    thick, wide, long = hand["finger_mm"]
    tip = hand["tip_mm"]
    side = np.cross(approach, n)
    R = np.column_stack([n, side, approach])
    boxes = []
    for sign, base in ((1.0, p), (-1.0, p - width * n)):
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = base + sign * thick / 2 * n + (tip - long / 2) * approach
        boxes.append(Box(T, np.array([thick, wide, long]) / 2))
    T = np.eye(4)
    T[:3, :3] = R
    palm = np.array([width / 2 + hand["palm_side_mm"], *hand["palm_half_mm"]])
    T[:3, 3] = p - width / 2 * n + (tip - long - palm[2]) * approach
    boxes.append(Box(T, palm))
    for box in boxes:
        local = np.abs((cloud - box.T[:3, 3]) @ box.T[:3, :3])
        if (local < box.half_mm - 0.06).all(axis=1).any():
            return None
    contact = []
    a, b = np.meshgrid(np.linspace(-0.48, 0.48, 9) * wide, np.linspace(tip - 14, tip - 0.2, 9))
    pad = a.ravel()[:, None] * side + b.ravel()[:, None] * approach
    cell = 0.96 * wide / 8 * 13.8 / 8
    for sign, base in ((1.0, p), (-1.0, p - width * n)):
        start = base + pad + sign * 0.5 * n
        hits, rows, _ = rays.intersects_location(
            start, np.repeat(-sign * n[None], len(pad), 0), multiple_hits=False
        )
        off = np.abs(((hits - start[rows]) * n).sum(axis=1)) - 0.5
        contact.append(float((off < 0.12).sum()) * cell)
    if min(contact) < hand["min_contact_mm2"]:
        return None
    return Grasp(tuple(boxes), n, approach, width, min(contact))


def find_views(
    body: trimesh.Trimesh,
    grasps: Sequence[Grasp],
    sight: Sight,
    held_mm: float,
    rng: np.random.Generator,
    places_mm: Array,
) -> tuple[list[View], float]:
    """Return three or four views a grasp, and the share of the surface that one of them shows.

    Parameters
    ----------
    body : the part as it is
    grasps : how it is held
    sight : the camera
    held_mm : height above the panel at which parts are shown
    rng : draws
    places_mm : (n, 3) to be shown twice, if that is possible

    Raises
    ------
    NoHoldError : no view has the part in the picture
    """
    points, faces = trimesh.sample.sample_surface(body, SAMPLES, seed=int(rng.integers(2**31)))
    normals = body.face_normals[faces]
    close = np.zeros(len(points))
    if len(places_mm):
        d = np.linalg.norm(points[:, None] - places_mm, axis=2).min(axis=1)
        close = np.where(d < 6.0, 30.0 / max((d < 6.0).sum(), 1), 0.0)
    middle = body.bounding_box.centroid
    seen_by: list[tuple[View, Array]] = []
    wanted: list[float] = []
    for number, grasp in enumerate(grasps):
        parts = [body]
        for box in grasp.boxes:
            one = trimesh.creation.box(2 * box.half_mm)
            one.apply_transform(box.T)
            parts.append(one)
        rays = trimesh.ray.ray_pyembree.RayMeshIntersector(trimesh.util.concatenate(parts))
        for towards in _directions(rng):
            T = shown(towards, middle, held_mm, rng)
            if not _is_inside(body, T, sight):
                continue
            eye = T[:3, :3].T @ (sight.T_world_cam[:3, 3] - T[:3, 3])
            look = eye - points
            away = np.linalg.norm(look, axis=1)
            look /= away[:, None]
            facing = (look * normals).sum(axis=1)
            rows = np.flatnonzero(facing > SEEN_COS)
            start = points[rows] + 0.02 * normals[rows]
            is_hidden = rays.intersects_any(start, look[rows])
            cos = np.zeros(len(points))
            cos[rows[~is_hidden]] = facing[rows[~is_hidden]]
            seen_by.append((View(number, T), cos))
            wanted.append(SQUARE if np.abs(towards).max() > 0.97 else 1.0)
    picked: list[View] = []
    counts = np.zeros(len(points))
    weight = 1.0 / len(points) * np.ones(len(points)) + close / max(len(points), 1) * 0.3
    for number in range(len(grasps)):
        for _ in range(3 + int(rng.integers(2))):
            mine = [i for i, (v, _) in enumerate(seen_by) if v.grasp == number and v not in picked]
            if not mine:
                raise NoHoldError("the part does not fit into the picture")
            cosines = [seen_by[i][1] for i in mine]
            gains = [
                wanted[i] * float((weight * (c > 0) * c * 0.25 ** np.minimum(counts, 3)).sum())
                for i, c in zip(mine, cosines, strict=True)
            ]
            best = mine[int(np.argmax(np.array(gains) * rng.uniform(0.85, 1.0, len(gains))))]
            picked.append(seen_by[best][0])
            counts += seen_by[best][1] > 0
    return picked, float((counts > 0).mean())


def _directions(rng: np.random.Generator) -> list[Array]:
    """Return directions of the part that are turned to the camera: near its axes, and between."""
    out = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            d = sign * np.eye(3)[axis]
            for spread_deg in (2.0, 6.0, 12.0):
                out.append(_tilted(d, spread_deg, rng))
    for _ in range(16):
        d = rng.normal(size=3)
        out.append(d / np.linalg.norm(d))
    return out


def _tilted(d: Array, spread_deg: float, rng: np.random.Generator) -> Array:
    out: Array = d + np.tan(np.radians(spread_deg)) * rng.normal(size=3) / np.sqrt(2)
    out /= np.linalg.norm(out)
    return out


def shown(towards: Array, middle: Array, held_mm: float, rng: np.random.Generator) -> Array:
    """Return a pose whose z axis is a direction of the part, turned anyhow."""
    R = frame(towards, np.zeros(3))[:3, :3].T
    a = rng.uniform(0, 2 * np.pi)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ R
    T = np.eye(4)
    T[:3, :3] = R
    at = np.array([rng.uniform(-7, 7), rng.uniform(-5, 5), held_mm + rng.uniform(-8, 8)])
    T[:3, 3] = at - R @ middle
    return T


def _is_inside(body: trimesh.Trimesh, T: Array, sight: Sight) -> bool:
    corners = trimesh.bounds.corners(body.bounds) @ T[:3, :3].T + T[:3, 3]
    p = (corners - sight.T_world_cam[:3, 3]) @ sight.T_world_cam[:3, :3]
    uv = p[:, :2] / p[:, 2:] * [sight.K[0, 0], sight.K[1, 1]] + sight.K[:2, 2]
    last = np.array(sight.size_px) - 1 - MARGIN_PX
    return bool((uv >= MARGIN_PX).all() and (uv <= last).all())


def disturbed(T: Array, pivot: Array, mm: float, deg: float, rng: np.random.Generator) -> Array:
    """Return a pose moved and turned about a point of the world by at most so much."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = np.radians(deg) * rng.uniform(0.2, 1.0)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    R = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    shift = rng.normal(size=3)
    shift *= mm * rng.uniform(0.2, 1.0) / np.linalg.norm(shift)
    out = np.eye(4)
    out[:3, :3] = R @ T[:3, :3]
    out[:3, 3] = R @ (T[:3, 3] - pivot) + pivot + shift
    return out
