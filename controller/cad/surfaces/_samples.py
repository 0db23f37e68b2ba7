"""Points spread over every surface, to count coverage by."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..solid import Solid

Array = NDArray[np.float64]

OFF_EDGE = 0.04  # least barycentric coordinate of a sample in its triangle


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceSamples:
    """Sample points of a solid's surface, in the CAD frame.

    Attributes
    ----------
    points_mm, normals : (n, 3), outward unit normals
    face_ids : (n,) surface of each
    areas_mm2 : (n,) surface each stands for; they add up to the whole surface
    """

    points_mm: Array
    normals: Array
    face_ids: NDArray[np.int32]
    areas_mm2: Array


def sample_surface(solid: Solid, spacing_mm: float = 4.0, per_face: int = 6) -> SurfaceSamples:
    """Return sample points about ``spacing_mm`` apart, at least ``per_face`` on every surface.

    The draw is seeded by the part's content, so that the same file gives the same points.
    """
    rng = np.random.default_rng(int(solid.content_hash[:8], 16))
    triangle_areas = np.asarray(solid.mesh.area_faces)
    corners = np.asarray(solid.mesh.triangles)
    points, normals, ids, areas = [], [], [], []
    order = np.argsort(solid.face_of_triangle, kind="stable")
    runs = np.split(order, np.cumsum(np.bincount(solid.face_of_triangle))[:-1])
    for face, run in zip(solid.faces, runs, strict=True):
        count = max(per_face, round(face.area_mm2 / spacing_mm**2))
        shares = np.cumsum(triangle_areas[run])
        if shares[-1] <= 0:
            continue
        # stratified along the cumulated area, so that no part of a surface is left bare
        marks = (np.arange(count) + rng.random(count)) / count * shares[-1]
        chosen = run[np.minimum(np.searchsorted(shares, marks), len(run) - 1)]
        a, b = rng.random((2, count))
        flip = a + b > 1
        a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
        # kept off all three edges, where a ray may slip between two triangles
        a, b = OFF_EDGE + (1 - 3 * OFF_EDGE) * a, OFF_EDGE + (1 - 3 * OFF_EDGE) * b
        c = corners[chosen]
        points.append(c[:, 0] + a[:, None] * (c[:, 1] - c[:, 0]) + b[:, None] * (c[:, 2] - c[:, 0]))
        normals.append(np.asarray(solid.mesh.face_normals)[chosen])
        ids.append(np.full(count, face.id, dtype=np.int32))
        areas.append(np.full(count, face.area_mm2 / count))
    return SurfaceSamples(
        np.vstack(points), np.vstack(normals), np.concatenate(ids), np.concatenate(areas)
    )
