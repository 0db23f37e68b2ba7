"""Creases, the meeting of two surfaces along an edge: convex, concave or smooth.

The angle is taken between the true normals at the edge's own points, not between facets: where a
coarse fillet runs into a plane, facets kink by half a segment and the surfaces do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.arrays import FloatArray, IntArray

from .._normals import surface_normals, unit
from .._types import Crease, Face
from .halfedges import HalfEdges

SMOOTH_RAD = np.radians(3.0)  # recognised axes are right to a fraction of a degree
FREEFORM_SMOOTH_RAD = np.radians(15.0)  # facets of a surface without formula, a segment apart


@dataclass(frozen=True, eq=False, slots=True)
class Creases:
    """`Crease` of each edge (e,) and its mean angle (e,)."""

    crease: NDArray[np.int8]
    angle_rad: FloatArray


def find_creases(
    mesh: trimesh.Trimesh,
    sides: HalfEdges,
    order: IntArray,
    start: IntArray,
    faces: Sequence[Face],
    face_of: IntArray,
) -> Creases:
    """Return the kind and the angle of the crease along each edge between two surfaces.

    Parameters
    ----------
    mesh : closed, CAD frame [mm]
    sides : its half-edges
    order, start : mesh half-edges of edge e are ``order[start[e]:start[e + 1]]``
    faces : the surfaces, as ``face_of`` numbers them
    face_of : (h,) surface to the left of each mesh half-edge
    """
    count = len(start) - 1
    if count == 0:
        return Creases(np.zeros(0, dtype=np.int8), np.zeros(0))
    vertices = np.asarray(mesh.vertices)
    facets = np.asarray(mesh.face_normals)
    other = sides.twin[order]
    begin, end = vertices[sides.origin[order]], vertices[sides.origin[other]]
    along = end - begin
    length = np.linalg.norm(along, axis=1)
    edge = np.repeat(np.arange(count), np.diff(start))
    signed = np.zeros(len(order))
    for points in (begin, end):
        left = surface_normals(faces, face_of[order], points, facets[order // 3])
        right = surface_normals(faces, face_of[other], points, facets[other // 3])
        sine = (np.cross(left, right) * unit(along)).sum(axis=1)
        signed += np.arctan2(sine, (left * right).sum(axis=1)) / 2
    total = np.bincount(edge, weights=length, minlength=count)
    angle = np.bincount(edge, weights=signed * length, minlength=count) / np.maximum(total, 1e-12)
    freeform = np.array([face.kind == "freeform" for face in faces])
    loose = freeform[face_of[order[start[:-1]]]] | freeform[face_of[other[start[:-1]]]]
    smooth = np.abs(angle) < np.where(loose, FREEFORM_SMOOTH_RAD, SMOOTH_RAD)
    crease = np.where(smooth, Crease.SMOOTH, np.where(angle > 0, Crease.CONVEX, Crease.CONCAVE))
    return Creases(crease.astype(np.int8), np.where(smooth, 0.0, np.abs(angle)))
