"""Visibility of the bare part by direction, by rays through the real, perspective camera."""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import RayCaster

from ._rules import VisibilityRules

LIFT_MM = 0.02  # sight lines start this far off the surface, or they would meet it
# Distance of the four lines of sight of which two must be free. A ray exactly between two
# triangles may meet neither, and a face behind would look visible (planning-facts.md 3.2).
JITTER_MM = 0.03
CHUNK_SIZE = 200_000


def eyes_of(solid: Solid, vectors: FloatArray, rules: VisibilityRules) -> FloatArray:
    """Return the camera positions for directions (v, 3) [mm, CAD frame].

    Parameters
    ----------
    solid : the part, its centre of mass at the station
    vectors : (v, 3) unit, from the part to the camera, CAD frame
    rules : distance of the camera
    """
    return np.asarray(solid.centroid_mm + rules.distance_mm * vectors)


def visible_from(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    vectors: FloatArray,
    rules: VisibilityRules,
) -> BoolArray:
    """Return a mask (v, n) of the samples that the bare part shows well in each direction.

    The same for all rolls about the sight line; which part of it is in the picture is not, see
    `hold_up`.

    Parameters
    ----------
    solid : the part
    samples : n, of its surface
    caster : rays against its mesh
    vectors : (v, 3) unit, from the part to the camera, CAD frame
    rules : camera distance, and the limits on a surface's incidence
    """
    visible = np.zeros((len(vectors), len(samples.points_mm)), dtype=bool)
    from_com = samples.points_mm - solid.centroid_mm
    for rows in chunks(len(vectors), len(samples.points_mm)):
        eyes = eyes_of(solid, vectors[rows], rules)
        depth = rules.depth_bounds_mm(from_com, vectors[rows])
        good = rules.shows(cosines(samples, eyes), depth, samples.face_ids)
        visible[rows] = free_sight_lines(samples, caster, good, eyes)
    return visible


def chunks(count: int, each: int) -> list[slice]:
    """Return runs of rows, of `each` elements, that fit the processor's cache."""
    rows = max(1, CHUNK_SIZE // max(1, each))
    return [slice(k, min(k + rows, count)) for k in range(0, count, rows)]


def cosines(samples: SurfaceSamples, eyes: FloatArray) -> FloatArray:
    """Return the cosine of the incidence at which eyes (v, 3) see each sample (v, n)."""
    p, n = samples.points_mm, samples.normals
    ahead = eyes @ n.T - np.einsum("ij,ij->i", p, n)
    square = np.einsum("ij,ij->i", eyes, eyes)[:, None] - 2 * eyes @ p.T
    return np.asarray(ahead / np.sqrt(square + np.einsum("ij,ij->i", p, p)))


def free_sight_lines(
    samples: SurfaceSamples, caster: RayCaster, asked: BoolArray, eyes: FloatArray
) -> BoolArray:
    """Return a mask (v, n) of the samples with a free line of sight to an eye past the part.

    Parameters
    ----------
    samples : n, of the surface, CAD frame
    caster : rays against the part's mesh
    asked : (v, n) mask of those to test; the others are False
    eyes : (v, 3) positions of the camera, CAD frame [mm]
    """
    eye, member = np.nonzero(asked)
    result = np.zeros_like(asked)
    result[eye, member] = free_pairs(samples, caster, member, eyes[eye])
    return result


def free_pairs(
    samples: SurfaceSamples, caster: RayCaster, member: IntArray, eyes: FloatArray
) -> BoolArray:
    """Return a mask (k,) of samples with a free line of sight to their own eye (k, 3).

    Parameters
    ----------
    samples : samples of the surface, CAD frame
    caster : rays against the part's mesh
    member : (k,) numbers of samples
    eyes : (k, 3) a position of the camera for each, CAD frame [mm]
    """
    n = samples.normals[member]
    start = samples.points_mm[member] + LIFT_MM * n
    free: BoolArray = first_met(caster, start, eyes) < 0
    (again,) = np.nonzero(free)
    if len(again):
        n = n[again]
        side = np.cross(n, np.eye(3)[np.argmin(np.abs(n), axis=1)])
        side *= JITTER_MM / np.linalg.norm(side, axis=1)[:, None]
        other = np.cross(n, side)
        sure = np.zeros(len(again), dtype=bool)
        # three ways, for beside an inner edge two of them may lead into the other face
        for step in (side, 0.87 * other - 0.5 * side, -0.87 * other - 0.5 * side):
            (left,) = np.nonzero(~sure)
            rows = again[left]
            sure[left] = first_met(caster, start[rows] + step[left], eyes[rows]) < 0
        free[again] = sure
    return free


def first_met(caster: RayCaster, start: FloatArray, eyes: FloatArray) -> IntArray:
    """Return the triangle each line meets first before its end (n,), -1 for none.

    Parameters
    ----------
    caster : rays against the part's mesh, CAD frame
    start : (n, 3) just off the surface [mm]
    eyes : (n, 3) ends of the lines [mm]
    """
    triangle, along = caster.first_hit(start, eyes - start, np.ones(len(start)))
    return np.where(along < 1.0, triangle, -1).astype(np.int64)
