"""Polygons of a mesh file -> triangles."""

from collections.abc import Sequence

import manifold3d
import numpy as np

from controller.arrays import FloatArray, IntArray


def triangles_of(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> IntArray:
    """Return polygons as triangles (n, 3), each polygon in its own sense.

    Triangles stay unchanged, convex polygons become fans; others are cut in their mean plane.

    Parameters
    ----------
    vertices : (v, 3)
    polygons : rows of ``vertices``, all in range; those of fewer than three are left out
    """
    found: list[tuple[int, int, int]] = []
    for polygon in polygons:
        if len(polygon) == 3:
            found.append((polygon[0], polygon[1], polygon[2]))
        elif len(polygon) > 3:
            found += _cut(vertices[list(polygon)], polygon)
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def _cut(corners: FloatArray, polygon: Sequence[int]) -> list[tuple[int, int, int]]:
    fan = [(0, k, k + 1) for k in range(1, len(polygon) - 1)]
    arms = corners - corners[0]
    doubled = np.cross(arms[1:-1], arms[2:])  # of the fan's triangles
    normal = doubled.sum(axis=0)
    length = float(np.linalg.norm(normal))
    if length > 0.0 and not (doubled @ normal >= 0.0).all():
        normal /= length
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u /= np.linalg.norm(u)
        flat = np.column_stack([arms @ u, arms @ np.cross(normal, u)])
        fan = [(int(a), int(b), int(c)) for a, b, c in manifold3d.triangulate([flat])]
    return [(polygon[a], polygon[b], polygon[c]) for a, b, c in fan]
