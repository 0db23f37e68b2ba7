"""Predicted outline of a posed part, point by point, with its adjacent faces."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.imaging import Camera, inverse_pose, meet_part, transform
from controller.recognition.fitting import ModelEdgePoints, edge_jacobian, predict_outline

from .._pose import PosedPart
from ..limits import SLIT_PX

SMOOTH: Final = 0.9  # least cosine between normals of two faces that move an outline together
RIM: Final = 0.94  # least cosine between a chord of a circle and its tangent there
AHEAD_MM: Final = 0.2  # step along an edge for its direction in the picture
# Degrees of freedom of a face: growth along its normals, and the shift of a curved one.
FREEDOMS: Final = 4


@dataclass(frozen=True, eq=False, slots=True)
class Rims:
    """Points of a predicted outline, n in number.

    Attributes
    ----------
    points : their positions, and their normals from the part to the ground
    jacobian : (n, 6) derivatives of their offset along the normals by the part's pose: shift of the
        centre of mass along the axes of the CAD frame [px / mm], rotations about them [px / rad]
    faces : (n, 2) ids of the faces on both sides
    per_face : (n, 2, 4) derivatives [px / mm] by the growth of each of these faces along its
        normals, and by its shift along the axes of the CAD frame, which moves curved faces only
    facet_px : (n,) largest distance of a curved face's facets from its surface
    """

    points: ModelEdgePoints
    jacobian: FloatArray
    faces: IntArray
    per_face: FloatArray
    facet_px: FloatArray


def find_rims(
    part: PosedPart, T_world_part: FloatArray, camera: Camera, most: float, step_mm: float
) -> Rims:
    """Return the outline of a posed part with its derivatives.

    Parameters
    ----------
    part : the part
    T_world_part : (4, 4)
    camera : calibrated, in the world's frame
    most : approximate number of points
    step_mm : least distance between them
    """
    model = part.edges
    edges = predict_outline(model, T_world_part, camera, most, step_mm)
    if np.isinf(most) and len(edges.pixels):
        beside = camera.sight_lines(edges.pixels + SLIT_PX * edges.normals)
        met, _ = meet_part(part.caster, T_world_part, camera.position_mm, beside)
        edges = _those(edges, np.flatnonzero(met < 0))
    triangles = model.sides[edges.edge].astype(np.int64)
    faces = part.solid.face_of_triangle[triangles].astype(np.int64)
    rounds = _Rounds(part)
    edges = _round_normals(part, rounds, edges, faces, T_world_part, camera)
    R = T_world_part[:3, :3]
    pivot = transform(T_world_part, model.centroid_mm[None])[0]
    world = edge_jacobian(edges.points_mm, edges.normals, pivot, camera)
    along = world[:, :3] @ R
    jacobian = np.hstack([along, world[:, 3:] @ R])
    local = transform(inverse_pose(T_world_part), edges.points_mm)
    first = rounds.even(model.first[edges.edge, :3], faces[:, 0], local)
    second = rounds.even(model.second[edges.edge, :3], faces[:, 1], local)
    is_plane = np.array([face.kind == "plane" for face in part.solid.faces])
    return Rims(
        points=edges,
        jacobian=jacobian,
        faces=faces,
        per_face=_per_face(along, first, second, is_plane[faces]),
        facet_px=_facets(part, edges.edge, triangles, faces, np.linalg.norm(along, axis=1)),
    )


class _Rounds:
    """Faces of a part that close round an axis."""

    def __init__(self, part: PosedPart) -> None:
        self._axes = np.array([face.axis for face in part.solid.faces])
        self._centres = np.array([face.centre_mm for face in part.solid.faces])
        self.is_round: BoolArray = np.any(self._axes, axis=1)

    def tangents(self, faces: IntArray, local_mm: FloatArray) -> FloatArray:
        """Return unit tangents (n, 3) about the axes of faces (n,) at points (n, 3), CAD frame."""
        tangent = np.cross(self._axes[faces], local_mm - self._centres[faces])
        size = np.linalg.norm(tangent, axis=1, keepdims=True)
        return np.asarray(tangent / np.maximum(size, 1e-12))

    def even(self, normals: FloatArray, faces: IntArray, local_mm: FloatArray) -> FloatArray:
        """Return the normals (n, 3) of facets, replaced by those of their round faces (n,)."""
        tangent = self.tangents(faces, local_mm)
        out = normals - (normals * tangent).sum(axis=1, keepdims=True) * tangent
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
        return np.where(self.is_round[faces][:, None], out, normals)


def _round_normals(
    part: PosedPart,
    rounds: _Rounds,
    edges: ModelEdgePoints,
    faces: IntArray,
    T_world_part: FloatArray,
    camera: Camera,
) -> ModelEdgePoints:
    """Return points and normals on the true circles in place of chords of round faces' rims.

    The chords of a disc would show its rotation about the axis, which a round disc does not.

    Parameters
    ----------
    part : the part, with its edges
    rounds : its round faces
    edges : predicted edges
    faces : (n, 2) faces on both sides of them
    T_world_part : (4, 4)
    camera : of the view
    """
    which = np.where(rounds.is_round[faces[:, 0]], faces[:, 0], faces[:, 1])
    along = part.edges.along_mm[edges.edge] / part.edges.length_mm[edges.edge][:, None]
    tangent = rounds.tangents(which, transform(inverse_pose(T_world_part), edges.points_mm))
    is_rim = rounds.is_round[which] & (np.abs((along * tangent).sum(axis=1)) > RIM)
    if not is_rim.any():
        return edges
    points = edges.points_mm[is_rim]
    ahead = points + AHEAD_MM * tangent[is_rim] @ T_world_part[:3, :3].T
    run = camera.project(ahead) - camera.project(points)
    run /= np.maximum(np.linalg.norm(run, axis=1, keepdims=True), 1e-12)
    turned = np.column_stack([-run[:, 1], run[:, 0]])
    before = edges.normals[is_rim]
    turned *= np.sign((turned * before).sum(axis=1, keepdims=True))
    normals = edges.normals.copy()
    # A chord of a circle seen nearly edge-on may look turned too far, and is left as it is.
    close = (turned * before).sum(axis=1) > RIM
    normals[np.flatnonzero(is_rim)[close]] = turned[close]
    return replace(edges, normals=normals)


def _those(edges: ModelEdgePoints, which: IntArray) -> ModelEdgePoints:
    return ModelEdgePoints(
        edges.points_mm[which],
        edges.pixels[which],
        edges.normals[which],
        edges.on_outline[which],
        edges.lift[which],
        edges.jump_mm[which],
        edges.step_mm,
        edges.edge[which],
    )


def _per_face(
    along: FloatArray, first: FloatArray, second: FloatArray, is_plane: FloatArray
) -> FloatArray:
    """Return the derivatives of outline points by the motion of faces, (n, 2, 4).

    A sharp edge follows its two faces: the shortest d with n1 d = s1 and n2 d = s2. Two faces that
    join smoothly move their outline together.
    """
    cosine = np.einsum("ij,ij->i", first, second)
    a, b = (np.einsum("ij,ij->i", along, n) for n in (first, second))
    is_smooth = np.abs(cosine) > SMOOTH
    sine2 = np.where(is_smooth, 1.0, 1.0 - cosine**2)
    grown = np.column_stack([(a - cosine * b) / sine2, (b - cosine * a) / sine2])
    grown[is_smooth] = 0.5 * np.column_stack([a, b])[is_smooth]
    normals = np.stack([first, second], axis=1)
    normals[is_plane] = 0.0
    return np.concatenate([grown[..., None], grown[..., None] * normals], axis=2)


def _facets(
    part: PosedPart, edge: IntArray, triangles: IntArray, faces: IntArray, px_per_mm: FloatArray
) -> FloatArray:
    """Return the distance (n,) of facets from their curved face [px], about w a / 8."""
    model = part.edges
    inside = faces[:, 0] == faces[:, 1]
    normals = model.normals[triangles]
    bend = np.arccos(np.clip(np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]), -1.0, 1.0))
    areas = part.solid.mesh.area_faces[triangles].min(axis=1)
    width = 2 * areas / np.maximum(model.length_mm[edge], 1e-9)
    return np.asarray(np.where(inside, width * bend / 8, 0.0) * px_per_mm)
