"""Faces of a STEP file that are one surface: some CAD systems cut every bore into two or four.

Two faces are one if they share an edge and have the same plane, cylinder, cone, sphere or torus, to
a micrometre at all points of both. Freeform faces stay unchanged.
"""

from itertools import pairwise
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray, IntArray

from ...graph import grouped

KINDS: Final = (
    "plane",
    "cylinder",
    "cone",
    "sphere",
    "torus",
    "freeform",
)  # of the kernel's measures
SAME_MM: Final = 1e-3
SAME_COS: Final = 1 - 5e-7  # 0.06 degrees: small faces say little about their own direction


def merge_faces(found: dict[str, Any]) -> tuple[dict[str, Any], IntArray]:
    """Return the kernel's arrays with one face for each surface, and the new number of each face.

    Parameters
    ----------
    found : arrays by name, of f faces

    Returns
    -------
    the arrays, of g faces, and (f,) the new number of each face
    """
    count = len(found["kind"])
    parent = np.arange(count)

    def root(i: int) -> int:
        while parent[i] != i:
            i = int(parent[i])
        return i

    points = _points_by_face(found)
    pairs = np.unique(np.sort(found["edge_faces"], axis=1), axis=0)
    for a, b in pairs[(pairs[:, 0] >= 0) & (pairs[:, 0] != pairs[:, 1])].tolist():
        if root(a) != root(b) and _are_one(found, a, b, points):
            parent[max(root(a), root(b))] = min(root(a), root(b))
    firsts, into = np.unique([root(i) for i in range(count)], return_inverse=True)
    if len(firsts) == count:
        return found, into
    return _merged(found, into, len(firsts)), into


def _points_by_face(found: dict[str, Any]) -> list[FloatArray]:
    of = found["face_of_triangle"]
    order, ends = grouped(of, len(found["kind"]))
    corners = found["triangles"][order]
    vertices = found["vertices_mm"]
    return [vertices[np.unique(corners[start:end])] for start, end in pairwise(ends)]


def _are_one(found: dict[str, Any], a: int, b: int, points: list[FloatArray]) -> bool:
    kind = KINDS[int(found["kind"][a])]
    if found["kind"][a] != found["kind"][b] or kind == "freeform":
        return False
    if kind != "sphere" and abs(float(found["axis"][a] @ found["axis"][b])) < SAME_COS:
        return False
    return all(
        float(np.abs(distance(found, of, points[on])).max(initial=0.0)) <= SAME_MM
        for of, on in ((a, b), (b, a))
    )


def distance(found: dict[str, Any], face: int, points: FloatArray) -> FloatArray:
    """Return the distances (n,) of points from a face's surface, extended past its borders [mm].

    Parameters
    ----------
    found : arrays by name, as the kernel leaves them
    face : number of the face; no freeform
    points : (n, 3) [mm]
    """
    kind = KINDS[int(found["kind"][face])]
    arm = points - found["place_mm"][face]
    height = arm @ found["axis"][face]
    radius, minor, half_angle = found["radii"][face]
    if kind == "plane":
        return np.asarray(height)
    if kind == "sphere":
        return np.asarray(np.linalg.norm(arm, axis=1) - radius)
    away = np.linalg.norm(arm - height[:, None] * found["axis"][face], axis=1)
    if kind == "torus":
        return np.asarray(np.hypot(away - radius, height) - minor)
    # a cylinder is a cone of half angle 0; beyond its apex a cone has a second half
    return np.asarray((away - np.abs(radius + height * np.tan(half_angle))) * np.cos(half_angle))


def _merged(found: dict[str, Any], into: IntArray, count: int) -> dict[str, Any]:
    area = np.bincount(into, found["area_mm2"], count)
    mean = np.column_stack(
        [np.bincount(into, found["area_mm2"] * found["mean_mm"][:, k], count) for k in range(3)]
    )
    largest = np.zeros(count, dtype=np.int64)
    for face in np.argsort(found["area_mm2"], kind="stable"):
        largest[into[face]] = face
    edges = found["edge_faces"]
    return found | {
        "face_of_triangle": into[found["face_of_triangle"]],
        "edge_faces": np.where(edges < 0, -1, into[edges]),
        "area_mm2": area,
        "mean_mm": mean / area[:, None],
        **{name: found[name][largest] for name in ("kind", "place_mm", "axis", "radii")},
    }
