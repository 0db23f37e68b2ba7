"""What the bare part shows in each direction, by rays through the real, perspective camera."""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import RayCaster

from ._rules import SightRules

LIFT_MM = 0.02  # sight lines start this far off the surface, or they would meet it
# rays that pass exactly between two triangles may meet neither, and a face behind would look
# visible (planning-facts.md 3.2): of three lines this far apart two must be free
JITTER_MM = 0.03
CHUNK_N = 200_000


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
    `hold_up`.
    """
    visible = np.zeros((len(vectors), len(samples.points_mm)), dtype=bool)
    from_com = samples.points_mm - solid.centroid_mm
    for rows in chunks(len(vectors), len(samples.points_mm)):
        eyes = eyes_of(solid, vectors[rows], rules)
        good = rules.shows(cosines(samples, eyes), rules.depth_bounds_mm(from_com, vectors[rows]))
        visible[rows] = free_sights(samples, caster, good, eyes)
    return visible


def chunks(count: int, each: int) -> list[slice]:
    """Return runs of rows, of `each` elements, that fit the processor's cache."""
    rows = max(1, CHUNK_N // max(1, each))
    return [slice(k, min(k + rows, count)) for k in range(0, count, rows)]


def cosines(samples: SurfaceSamples, eyes: FloatArray) -> FloatArray:
    """Return the cosine of the incidence at which eyes (v, 3) see each sample (v, n)."""
    p, n = samples.points_mm, samples.normals
    ahead = eyes @ n.T - np.einsum("ij,ij->i", p, n)
    square = np.einsum("ij,ij->i", eyes, eyes)[:, None] - 2 * eyes @ p.T
    return np.asarray(ahead / np.sqrt(square + np.einsum("ij,ij->i", p, p)))


def free_sights(
    samples: SurfaceSamples, caster: RayCaster, asked: BoolArray, eyes: FloatArray
) -> BoolArray:
    """Tell which samples asked for (v, n) eyes (v, 3) see past the part itself (v, n)."""
    eye, member = np.nonzero(asked)
    n = samples.normals[member]
    start = samples.points_mm[member] + LIFT_MM * n
    free = first_met(caster, start, eyes[eye]) < 0
    (again,) = np.nonzero(free)
    if len(again):
        n = n[again]
        side = np.cross(n, np.eye(3)[np.argmin(np.abs(n), axis=1)])
        side *= JITTER_MM / np.linalg.norm(side, axis=1)[:, None]
        other = np.cross(n, side)
        votes = np.zeros(len(again), dtype=np.int64)
        for step in (side, 0.87 * other - 0.5 * side):
            votes += first_met(caster, start[again] + step, eyes[eye[again]]) < 0
        free[again] = votes >= 1
    result = np.zeros_like(asked)
    result[eye, member] = free
    return result


def first_met(caster: RayCaster, start: FloatArray, eyes: FloatArray) -> IntArray:
    """Return the triangle each line (n, 3) -> (n, 3) meets first before its end, -1 for none."""
    triangle, along = caster.first_hit(start, eyes - start, np.ones(len(start)))
    return np.where(along < 1.0, triangle, -1).astype(np.int64)
