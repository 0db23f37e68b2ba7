"""Pairs of planar faces that look away from each other, or at each other, and their overlap.

Exact: outlines are unions of the mesh's own triangles, holes included (planning-facts.md 2.2, step
1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from controller.arrays import FloatArray
from controller.cad import Face, Solid

OPPOSED_COS = np.cos(np.radians(2.0))
BARE_MM2 = 20.0  # a smaller common area cannot make a contact: a pad's rule requires more


@dataclass(frozen=True, slots=True, eq=False)
class FacePair:
    """Two opposed planar faces and their overlap.

    Attributes
    ----------
    gap_mm : distance between their planes; negative if they face each other, as in a channel
    overlap : both, projected on the plane between them, intersected; holes are left out
    u, v : (3,) axes of that plane
    height_mm : height of that plane along the first face's normal
    """

    first: Face
    second: Face
    gap_mm: float
    overlap: BaseGeometry
    u: FloatArray
    v: FloatArray
    height_mm: float


def opposed_faces(
    solid: Solid, widest_mm: float, inner_low_mm: float = 0.0, inner_high_mm: float = 0.0
) -> list[FacePair]:
    """Return the pairs of planar faces with opposed normals (2 degrees) that overlap.

    The overlap is exact: the triangles of either face, projected and united, intersected.

    Parameters
    ----------
    solid : with its faces
    widest_mm : largest distance of two faces that are held from outside
    inner_low_mm, inner_high_mm : distances between which two faces are held from inside; 0 and 0
        for never
    """
    planes = [f for f in solid.faces if f.kind == "plane" and f.area_mm2 > BARE_MM2]
    if len(planes) < 2:
        return []
    normals = np.stack([f.normal for f in planes])
    centres = np.stack([f.centre_mm for f in planes])
    opposed = np.triu(normals @ normals.T <= -OPPOSED_COS, 1)
    gaps = np.einsum("ijk,ik->ij", centres[:, None] - centres[None], normals)
    opposed &= ((gaps > 1.0) & (gaps <= widest_mm)) | (
        (gaps < -max(inner_low_mm, 1e-9)) & (gaps >= -inner_high_mm)
    )
    corners = np.asarray(solid.mesh.triangles)
    shapes: dict[tuple[int, tuple[float, ...]], BaseGeometry] = {}
    found = []
    for i, j in np.argwhere(opposed).tolist():
        a, b = planes[i], planes[j]
        # one frame for both senses of a direction, so that outlines are drawn once
        towards = np.round(a.normal, 6)
        first = towards[np.flatnonzero(np.abs(towards) > 1e-6)[0]]
        u, v = across(towards * np.sign(first))
        flat = np.column_stack([u, v])
        key = tuple(np.round(flat, 6).ravel().tolist())
        for f in (a, b):
            if (f.id, key) not in shapes:
                triangles = shapely.polygons(corners[solid.face_of_triangle == f.id] @ flat)
                outline = shapely.coverage_union_all(triangles[shapely.area(triangles) > 1e-9])
                shapes[f.id, key] = shapely.make_valid(outline)
        common = shapely.intersection(shapes[a.id, key], shapes[b.id, key])
        if common.area >= BARE_MM2:
            height = float((a.centre_mm + b.centre_mm) @ a.normal) / 2
            found.append(FacePair(a, b, float(gaps[i, j]), common, u, v, height))
    return found


def plane_seeds(pairs: Sequence[FacePair]) -> FloatArray:
    """Return seeds (n, 7) in the overlap of opposed faces: middle, axis, gap."""
    rows = []
    for pair in pairs:
        n = pair.first.normal
        for x, y in _inside(pair.overlap):
            middle = x * pair.u + y * pair.v + pair.height_mm * n
            rows.append([*middle, *n, abs(pair.gap_mm)])
    return np.reshape(np.array(rows, dtype=float), (-1, 7))


def _inside(shape: BaseGeometry, step_mm: float = 10.0, most: int = 30) -> list[FloatArray]:
    """Return points of a polygon: one inside for certain, its centroid, and a grid."""
    x0, y0, x1, y1 = shape.bounds
    step = max(step_mm, float(np.sqrt(shape.area / most)))
    xs = np.arange(x0 + step / 2, x1, step)
    ys = np.arange(y0 + step / 2, y1, step)
    grid = np.array(np.meshgrid(xs, ys)).reshape(2, -1).T
    sure, centroid = shape.representative_point(), shape.centroid
    points = np.vstack([[sure.x, sure.y], [centroid.x, centroid.y], grid])
    keep = shapely.contains_xy(shape, points[:, 0], points[:, 1])
    keep[0] = True
    return list(points[keep])


def across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors square to the axis and each other, along part axes if possible."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = helper - axis * (helper @ axis)
    u = u / np.linalg.norm(u)
    return u, np.cross(axis, u)
