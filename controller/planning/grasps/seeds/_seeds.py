"""Grasp seeds: exactly opposed faces, walls across a ray, and walls facing each other.

A seed is a point between two walls and the direction in which the jaws close there (or spread,
for a seed inside a bore or a channel). Source: planning-facts.md 2.2, steps 1 and 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import RayCaster

from ...model import GraspRules, Jaw
from ._faces import opposed_faces, plane_seeds

SKIN_MM = 0.02  # rays start this far off the surface they leave
MAIN_DIRECTIONS = 40  # directions of walls that are tried as partners of every sample


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Grasp seeds: points between two walls, and the axis along which the jaws move.

    Attributes
    ----------
    middle : (n, 3) in the part frame
    axis : (n, 3) unit vectors
    gap : (n,) mm between the walls
    inner : (n,) the jaw spreads between them
    samples : samples of the part's surface
    face_pairs : number of exactly opposed pairs of planar faces
    widest_mm : widest opening of the jaws for these seeds
    """

    middle: FloatArray
    axis: FloatArray
    gap: FloatArray
    inner: BoolArray
    samples: SurfaceSamples
    face_pairs: int
    widest_mm: float


def find_seeds(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    widest_mm: float,
    rules: GraspRules,
    spreading: Sequence[Jaw] = (),
) -> Seeds:
    """Return the seeds of grasps for jaws of up to a width: the same for both grippers.

    Parameters
    ----------
    solid : the part
    samples : samples of its surface
    caster : rays against its mesh
    widest_mm : largest distance of two walls that are held from outside
    rules : number of seeds, and the friction by which two walls count as opposed
    spreading : jaws; those that can spread get seeds inside bores and channels
    """
    low, high = _spread_widths(spreading, rules)
    pairs = opposed_faces(solid, widest_mm, low, high)
    some, few = rules.seed_count, rules.seed_count // 3
    kinds = [
        (plane_seeds([p for p in pairs if p.gap_mm > 0]), some, False),
        (_wall_seeds(solid, samples, caster, widest_mm, rules), some, False),
        (_slanted_seeds(solid, samples, caster, widest_mm, rules), few, False),
    ]
    if high > low:
        channels = plane_seeds([p for p in pairs if p.gap_mm < 0])
        bores = _bore_seeds(solid, samples, caster, low, high, rules)
        kinds += [(channels, few, True), (bores, few, True)]
    middle, axis, gap, inner = [], [], [], []
    for rows, count, spreads in kinds:
        chosen = rows[_spread_out(rows, count)]
        middle.append(chosen[:, :3])
        axis.append(chosen[:, 3:6])
        gap.append(chosen[:, 6])
        inner.append(np.full(len(chosen), spreads))
    return Seeds(
        np.vstack(middle),
        np.vstack(axis),
        np.concatenate(gap),
        np.concatenate(inner),
        samples,
        len([p for p in pairs if p.gap_mm > 0]),
        widest_mm,
    )


def _spread_widths(jaws: Sequence[Jaw], rules: GraspRules) -> tuple[float, float]:
    """Return the narrowest and the widest gap that any of the jaws holds from inside."""
    able = [j for j in jaws if j.can_spread]
    if not able:
        return 0.0, 0.0
    return min(narrowest_inner(j, rules) for j in able), max(widest_inner(j) for j in able)


def narrowest_inner(jaw: Jaw, rules: GraspRules) -> float:
    """Return the narrowest gap [mm] into which the closed fingers go with clearance."""
    return 2 * jaw.finger_thickness_mm + 2 * rules.bore_clearance_mm


def widest_inner(jaw: Jaw) -> float:
    """Return the largest distance between the backs of the fingers [mm]."""
    return jaw.max_mm + 2 * jaw.finger_thickness_mm


def _wall_seeds(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    widest_mm: float,
    rules: GraspRules,
) -> FloatArray:
    """Return seeds (n, 7) along normals, to the next exit from the material and to the far side."""
    p, n = samples.points_mm, samples.normals
    face_normals = np.asarray(solid.mesh.face_normals)
    cone = np.cos(np.arctan(rules.friction))
    outside = widest_mm + 1.0
    triangle, depth = caster.first_hit(p - outside * n, n)
    far = (triangle >= 0) & (depth > 1.0) & (depth < outside - 0.5)
    far &= np.einsum("ij,ij->i", face_normals[triangle], -n) >= cone
    through = _across_walls(p, n, n, face_normals, caster, widest_mm, cone)
    return np.vstack([through, _rows(p[far], n[far], outside - depth[far])])


def _slanted_seeds(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    widest_mm: float,
    rules: GraspRules,
) -> FloatArray:
    """Return seeds (n, 7) between walls that are not parallel, along the bisector of their normals.

    Round walls have none: a pad finds where they stand square to it by itself.
    """
    flat = np.array([f.kind not in ("cylinder", "sphere", "torus") for f in solid.faces])
    at, axis = bisectors(samples, np.arctan(rules.friction))
    keep = flat[samples.face_ids[at]]
    at, axis = at[keep], axis[keep]
    return _across_walls(
        samples.points_mm[at],
        samples.normals[at],
        axis,
        np.asarray(solid.mesh.face_normals),
        caster,
        widest_mm,
        float(np.cos(np.arctan(rules.friction))),
    )


def _across_walls(
    p: FloatArray,
    n: FloatArray,
    axis: FloatArray,
    face_normals: FloatArray,
    caster: RayCaster,
    widest_mm: float,
    cone: float,
) -> FloatArray:
    """Return seeds (k, 7) from surface points through the material against the axis."""
    triangle, depth = caster.first_hit(p - SKIN_MM * n, -axis)
    ok = (triangle >= 0) & (depth > 0.5) & (depth <= widest_mm)
    ok &= np.einsum("ij,ij->i", face_normals[triangle], -axis) >= cone
    return _rows(p[ok], axis[ok], depth[ok])


def _rows(p: FloatArray, axis: FloatArray, width: FloatArray) -> FloatArray:
    return np.hstack([p - axis * width[:, None] / 2, axis, width[:, None]])


def bisectors(samples: SurfaceSamples, max_rad: float) -> tuple[IntArray, FloatArray]:
    """Return sample numbers (k,) and axes (k, 3) halfway between a sample's normal and a wall's.

    The angle of the axis to both normals, which is the friction angle the two walls need, is
    between 1 degree and `max_rad`. Walls are the main directions of the surface, by area.
    """
    directions = _main_directions(samples)
    towards = samples.normals[:, None, :] - directions[None]
    length = np.linalg.norm(towards, axis=2)  # 2 cos of the angle needed
    need = np.arccos(np.clip(length / 2, 0.0, 1.0))
    at, wall = np.nonzero((need > np.radians(1.0)) & (need <= max_rad))
    return np.asarray(at, dtype=np.int64), towards[at, wall] / length[at, wall][:, None]


def _main_directions(samples: SurfaceSamples) -> FloatArray:
    """Return up to 40 main directions (k, 3) of walls, unit, most area first."""
    grid = np.round(samples.normals, 2)
    _, first, group = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    area = np.bincount(group.ravel(), weights=samples.areas_mm2)
    order = np.argsort(-np.round(area, 6), kind="stable")[:MAIN_DIRECTIONS]
    return samples.normals[first[order]]


def needed_friction(solid: Solid, seeds: Seeds, caster: RayCaster) -> tuple[float, float]:
    """Return the least friction angle [deg] that two walls of any width need; their width [mm].

    Over rays through the material along the surface's normals and along every bisector of a normal
    and a main wall direction; 90 and inf if nothing is opposed.

    Parameters
    ----------
    solid : the part
    seeds : with samples of its surface
    caster : rays against its mesh
    """
    at, axis = bisectors(seeds.samples, np.pi / 2 - 0.01)
    p, n = seeds.samples.points_mm, seeds.samples.normals
    p, n, axis = np.vstack([p, p[at]]), np.vstack([n, n[at]]), np.vstack([n, axis])
    triangle, depth = caster.first_hit(p - SKIN_MM * n, -axis)
    hit = (triangle >= 0) & (depth > 0.5)
    if not hit.any():
        return 90.0, np.inf
    there = np.asarray(solid.mesh.face_normals)[triangle]
    cos = np.minimum(np.einsum("ij,ij->i", n, axis), -np.einsum("ij,ij->i", there, axis))
    need = np.where(hit, np.degrees(np.arccos(np.clip(cos, -1.0, 1.0))), 180.0)
    best = need.min()
    return float(best), float(depth[hit & (need <= best + 0.1)].min())


def _bore_seeds(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    low_mm: float,
    high_mm: float,
    rules: GraspRules,
) -> FloatArray:
    """Return seeds (n, 7) from walls through the air to a wall that faces back."""
    p, n = samples.points_mm, samples.normals
    face_normals = np.asarray(solid.mesh.face_normals)
    triangle, width = caster.first_hit(p + SKIN_MM * n, n)
    ok = (triangle >= 0) & (width >= low_mm) & (width <= high_mm)
    ok &= np.einsum("ij,ij->i", face_normals[triangle], -n) >= np.cos(np.arctan(rules.friction))
    return _rows(p[ok], -n[ok], width[ok])


def _spread_out(rows: FloatArray, count: int) -> list[int]:
    # a grasp seen from the other side is the same grasp
    sign = np.where((rows[:, 3:6] @ np.array([0.9511, 0.2839, 0.1213])) < 0, -1.0, 1.0)
    features = np.hstack([rows[:, :3] / 15.0, rows[:, 3:6] * sign[:, None], rows[:, 6:] / 20.0])
    return farthest(features, count)


def farthest(features: FloatArray, count: int, start: int = 0) -> list[int]:
    """Return indices spread over features, greedily the farthest next.

    Parameters
    ----------
    features : (n, d) points, in units that compare
    count : at most so many; fewer where the rest are equal to those chosen
    start : index of the first
    """
    if len(features) == 0:
        return []
    chosen = [start]
    distance = np.linalg.norm(features - features[start], axis=1)
    while len(chosen) < min(count, len(features)):
        k = int(np.argmax(distance))
        if distance[k] < 1e-6:
            break
        chosen.append(k)
        distance = np.minimum(distance, np.linalg.norm(features - features[k], axis=1))
    return chosen
