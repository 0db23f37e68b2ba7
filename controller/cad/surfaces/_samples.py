"""Points spread over every surface, to count coverage by."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray, Int32Array

from ..boundary import surface_normals
from ..solid import Solid

OFF_EDGE = 0.04  # least barycentric coordinate of a sample in its triangle


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceSamples:
    """Sample points of a solid's surface, in the CAD frame.

    Attributes
    ----------
    points_mm : (n, 3), on triangles, off their edges
    normals : (n, 3), outward unit normals: of the recognised surface where it has a formula, so
        that a coarse bore's normals turn evenly; of the triangle otherwise
    face_ids : (n,) surface of each
    areas_mm2 : (n,) surface each stands for; they add up to the whole surface
    """

    points_mm: FloatArray
    normals: FloatArray
    face_ids: Int32Array
    areas_mm2: FloatArray


def sample_surface(solid: Solid, spacing_mm: float = 4.0, per_face: int = 6) -> SurfaceSamples:
    """Return sample points about ``spacing_mm`` apart, at least ``per_face`` on every surface.

    The draw is seeded by the part's content, so that the same file gives the same points.

    Parameters
    ----------
    solid : with its faces
    spacing_mm : each sample stands for about its square
    per_face : least number on a face, however small
    """
    rng = np.random.default_rng(int(solid.content_hash[:8], 16))
    areas = np.asarray(solid.mesh.area_faces)
    face_areas = np.bincount(solid.face_of_triangle, weights=areas, minlength=len(solid.faces))
    counts = np.maximum(per_face, np.rint(face_areas / spacing_mm**2)).astype(np.int64)
    counts[face_areas <= 0] = 0
    ids = np.repeat(np.arange(len(counts)), counts)
    order = np.argsort(solid.face_of_triangle, kind="stable")
    cumulated = np.cumsum(areas[order])
    # stratified along the cumulated area of its surface, so that no part of it is left bare
    place = np.arange(len(ids)) - np.repeat(np.cumsum(counts) - counts, counts)
    # drawn surface by surface, so that one more surface leaves the larger ones' points alone
    draws = [(rng.random(count), rng.random((2, count))) for count in counts.tolist()]
    marks = (place + np.concatenate([draw[0] for draw in draws])) / counts[ids] * face_areas[ids]
    ends = np.cumsum(np.bincount(solid.face_of_triangle, minlength=len(counts)))
    begins = np.concatenate([[0], ends[:-1]])
    offsets = np.concatenate([[0.0], cumulated])[begins]
    at = np.searchsorted(cumulated, offsets[ids] + marks)
    chosen = order[np.clip(at, begins[ids], ends[ids] - 1)]
    a, b = np.concatenate([draw[1] for draw in draws], axis=1)
    flip = a + b > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    # kept off all three edges, where a ray may slip between two triangles
    a, b = OFF_EDGE + (1 - 3 * OFF_EDGE) * a, OFF_EDGE + (1 - 3 * OFF_EDGE) * b
    c = np.asarray(solid.mesh.vertices)[np.asarray(solid.mesh.faces)[chosen]]
    points = c[:, 0] + a[:, None] * (c[:, 1] - c[:, 0]) + b[:, None] * (c[:, 2] - c[:, 0])
    facets = np.asarray(solid.mesh.face_normals)[chosen]
    return SurfaceSamples(
        points_mm=points,
        normals=surface_normals(solid.faces, ids, points, facets),
        face_ids=ids.astype(np.int32),
        areas_mm2=face_areas[ids] / counts[ids],
    )
