"""Sample points over every surface, to count coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, Int32Array, IntArray

from ..boundary import surface_normals
from ..large import spans
from ..solid import Solid

OFF_EDGE = 0.04  # least barycentric coordinate of a sample in its triangle
FACES_APART_MM = 1e5  # distance of faces in a fourth dimension, far beyond the size of any part


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
    reach_mm : no spot of a face is farther from a sample on it; None where that is not known
    """

    points_mm: FloatArray
    normals: FloatArray
    face_ids: Int32Array
    areas_mm2: FloatArray
    reach_mm: float | None = None

    def rows(self, which: IntArray) -> SurfaceSamples:
        """Return the samples with the given numbers (k,)."""
        return SurfaceSamples(
            self.points_mm[which], self.normals[which], self.face_ids[which], self.areas_mm2[which]
        )


def by_face(points_mm: FloatArray, face_ids: NDArray[np.integer]) -> FloatArray:
    """Return places (n, 4) of points in which a nearest neighbour is on the same face.

    Parameters
    ----------
    points_mm : (n, 3)
    face_ids : (n,) surface of each
    """
    return np.column_stack([points_mm, FACES_APART_MM * face_ids])


def sample_surface(solid: Solid, spacing_mm: float = 4.0, per_face: int = 6) -> SurfaceSamples:
    """Return sample points about ``spacing_mm`` apart, at least ``per_face`` on every surface.

    The draw is seeded by the part's content, so that the same file gives the same points.

    Parameters
    ----------
    solid : with its faces
    spacing_mm : spacing; each sample represents about its square
    per_face : least number on a face, however small
    """
    rng = np.random.default_rng(int(solid.content_hash[:8], 16))
    areas = face_areas_mm2(solid)
    counts = np.maximum(per_face, np.rint(areas / spacing_mm**2)).astype(np.int64)
    counts[areas <= 0] = 0
    # drawn surface by surface, so that one more surface leaves the larger ones' points alone
    draws = [(rng.random(count), rng.random((2, count))) for count in counts.tolist()]
    along = np.concatenate([draw[0] for draw in draws])
    across = np.concatenate([draw[1] for draw in draws], axis=1)
    return placed_samples(solid, counts, along, across, np.inf)


def face_areas_mm2(solid: Solid) -> FloatArray:
    """Return the area of the triangles of each face (f,)."""
    areas = np.asarray(solid.mesh.area_faces, dtype=np.float64)
    sums = np.bincount(solid.face_of_triangle, weights=areas, minlength=len(solid.faces))
    return sums.astype(np.float64)


def placed_samples(
    solid: Solid, counts: IntArray, along: FloatArray, across: FloatArray, off_edge_mm: float
) -> SurfaceSamples:
    """Return a given number of points (f,) on each face, in equal steps of its cumulated area.

    Parameters
    ----------
    solid : with its faces
    counts : points on each face; 0 only where it has no area
    along : (n,) place of each in its stretch, 0..1
    across : (2, n) place of each in its triangle, 0..1 along two of its sides
    off_edge_mm : least distance of a point from the edges of its triangle; `OFF_EDGE` of its height
        where that is less
    """
    areas = np.asarray(solid.mesh.area_faces)
    face_areas = face_areas_mm2(solid)
    ids = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    order = np.argsort(solid.face_of_triangle, kind="stable")
    cumulated = np.cumsum(areas[order])
    ends = np.cumsum(np.bincount(solid.face_of_triangle, minlength=len(counts)))
    begins = np.concatenate([[0], ends[:-1]])
    offsets = np.concatenate([[0.0], cumulated])[begins]
    firsts = np.cumsum(counts) - counts
    points, normals = np.empty((2, len(ids), 3))
    for span in spans(len(ids)):
        mine = ids[span]
        # stratified along the cumulated area of its surface, so that no part of it is left bare
        place = np.arange(span.start, span.stop) - firsts[mine]
        marks = (place + along[span]) / counts[mine] * face_areas[mine]
        at = np.searchsorted(cumulated, offsets[mine] + marks)
        chosen = order[np.clip(at, begins[mine], ends[mine] - 1)]
        points[span] = _inside(solid, chosen, across[:, span], off_edge_mm)
        facets = np.asarray(solid.mesh.face_normals)[chosen]
        normals[span] = surface_normals(solid.faces, mine, points[span], facets)
    return SurfaceSamples(points, normals, ids, (face_areas / np.maximum(counts, 1))[ids])


def _inside(solid: Solid, chosen: IntArray, across: FloatArray, off_edge_mm: float) -> FloatArray:
    """Return a point (n, 3) of each chosen triangle (n,), by its place in it (2, n)."""
    areas = np.asarray(solid.mesh.area_faces)
    a, b = across
    flip = a + b > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    c = np.asarray(solid.mesh.vertices)[np.asarray(solid.mesh.faces)[chosen]]
    # kept off all three edges, where a ray may slip between two triangles
    opposite = np.linalg.norm(np.roll(c, -1, axis=1) - np.roll(c, -2, axis=1), axis=2)
    heights = 2.0 * areas[chosen, None] / np.maximum(opposite, 1e-300)
    off = np.minimum(OFF_EDGE, off_edge_mm / np.maximum(heights, 1e-300))
    inner = 1.0 - off.sum(axis=1)
    a, b = off[:, 1] + inner * a, off[:, 2] + inner * b
    return np.asarray(c[:, 0] + a[:, None] * (c[:, 1] - c[:, 0]) + b[:, None] * (c[:, 2] - c[:, 0]))
