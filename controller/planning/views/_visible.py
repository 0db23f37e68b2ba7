"""What the bare part shows in each direction, by rays through the real, perspective camera."""

from __future__ import annotations

import numpy as np

from controller.cad import RayCaster, Solid, SurfaceSamples

from ..boxes import BoolArray
from ..layout import FloatArray, IntArray
from ._rules import SightRules

LIFT_MM = 0.02  # sight lines start this far off the surface, or they would meet it
# rays that pass exactly between two triangles may meet neither, and a face behind would look
# visible (planning.md 3.2): of three lines this far apart two must be free
JITTER_MM = 0.03


def eyes_of(solid: Solid, vectors: FloatArray, rules: SightRules) -> FloatArray:
    """Return where the camera stands in the part frame for each direction (v, 3)."""
    return np.asarray(solid.centroid_mm + rules.distance_mm * vectors)


def visible_from(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    vectors: FloatArray,
    rules: SightRules,
) -> BoolArray:
    """Return which samples the bare part shows well enough in each direction: (v, n) bool.

    The same for all rolls about the sight line; which part of it is in the picture is not, see
    `view_poses`.
    """
    visible = np.zeros((len(vectors), len(samples.points_mm)), dtype=bool)
    from_com = samples.points_mm - solid.centroid_mm
    for k, eye in enumerate(eyes_of(solid, vectors, rules)):
        cosine = cosines(samples, eye)
        (facing,) = np.nonzero(rules.shows(cosine, rules.depth_bounds_mm(from_com, vectors[k])))
        visible[k, facing] = free_sight(samples, caster, facing, eye)
    return visible


def cosines(samples: SurfaceSamples, eye: FloatArray) -> FloatArray:
    """Return the cosine of the incidence at which an eye (3,) or (n, 3) sees each sample (n,)."""
    sight = eye - samples.points_mm
    length = np.linalg.norm(sight, axis=1)
    return np.asarray(np.einsum("ij,ij->i", sight, samples.normals) / length)


def free_sight(
    samples: SurfaceSamples, caster: RayCaster, members: IntArray, eye: FloatArray
) -> BoolArray:
    """Tell which samples, by number (m,), an eye (3,) or (m, 3) sees past the part itself (m,)."""
    n = samples.normals[members]
    start = samples.points_mm[members] + LIFT_MM * n
    eyes = np.broadcast_to(eye, start.shape)
    free = first_met(caster, start, eyes) < 0
    (again,) = np.nonzero(free)
    if len(again):
        side = np.cross(n[again], np.eye(3)[np.argmin(np.abs(n[again]), axis=1)])
        side *= JITTER_MM / np.linalg.norm(side, axis=1)[:, None]
        other = np.cross(n[again], side)
        votes = np.zeros(len(again), dtype=np.int64)
        for step in (side, 0.87 * other - 0.5 * side):
            votes += first_met(caster, start[again] + step, eyes[again]) < 0
        free[again] = votes >= 1
    return np.asarray(free)


def first_met(caster: RayCaster, start: FloatArray, eyes: FloatArray) -> IntArray:
    """Return the triangle each line (n, 3) -> (n, 3) meets first before its end, -1 for none."""
    triangle, along = caster.first_hit(start, eyes - start, np.ones(len(start)))
    return np.where(along < 1.0, triangle, -1).astype(np.int64)
