"""Projection of a solid's vertices on a picture plane in which straight lines stay straight.

Seen from above the plane is in mm; through a camera it is the undistorted picture, its lengths
scaled to pixels, v up so that the eye's anticlockwise is the plane's. ``nearness`` is the height
above, or one over the depth: both are linear in the plane along any line and over any flat.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, Int32Array
from controller.imaging import Camera, inverse_pose, transform

from ._model import ViewModel

FRONT, EDGE_ON, BACK = 1, 0, -1
# A wall parallel to the line of sight is neither in front nor behind. CAD files in single precision
# and orientations found on hull facets turn it by up to some 1e-5 rad, and the width it then shows
# by up to 1e-4 mm: less than that is invisible.
EDGE_ON_RAD = 2e-5
EDGE_ON_MM = 1e-4
ALONG_RAD = 3e-4  # largest error of an axis fitted to a mesh


@dataclass(frozen=True, eq=False, slots=True)
class Projection:
    """A solid projected towards the eye.

    Attributes
    ----------
    points : (v, 2) vertices in the plane
    nearness : (v,) larger is nearer to the eye
    scale : plane units per mm at the part, 1 from above
    eye : (3,) in the CAD frame: the eye's position, or the direction towards it from above
    is_central : whether ``eye`` is a position
    facing : (t,) FRONT, EDGE_ON or BACK of each triangle
    matrix : (3, 4) matrix from homogeneous CAD coordinates to homogeneous plane coordinates
    wall : (e,) wall of each mesh edge: the bore or boss, seen along its axis, that it bounds, a
        face, or -1
    camera : None from above
    """

    points: FloatArray
    nearness: FloatArray
    scale: float
    eye: FloatArray
    is_central: bool
    facing: NDArray[np.int8]
    matrix: FloatArray
    wall: Int32Array
    camera: Camera | None

    def towards_eye(self, p_cad_mm: FloatArray) -> FloatArray:
        """Return the unit directions (n, 3) from points (n, 3) of the CAD frame to the eye."""
        if not self.is_central:
            return np.broadcast_to(self.eye, p_cad_mm.shape)
        d = self.eye - p_cad_mm
        unit: FloatArray = d / np.linalg.norm(d, axis=1, keepdims=True)
        return unit

    def to_view(self, plane: FloatArray) -> FloatArray:
        """Return plane points (n, 2) in the coordinates of the view: mm, or pixels."""
        if self.camera is None:
            return plane
        focal = float(self.camera.K[0, 0])
        rays = np.column_stack([plane / (focal, -focal), np.ones(len(plane))])
        if len(rays) == 0:
            return plane
        pixels, _ = cv2.projectPoints(
            rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self.camera.K, self.camera.distortion
        )
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def seen_from_above(model: ViewModel, R: FloatArray) -> Projection:
    """Return a part turned by ``R`` (3, 3), CAD to upright, projected straight down."""
    matrix = np.zeros((3, 4))
    matrix[:2, :3] = R[:2]
    matrix[:2, 3] = -R[:2] @ model.solid.centroid_mm
    matrix[2, 3] = 1.0
    upright = (model.vertices_mm - model.solid.centroid_mm) @ R.T
    points = np.ascontiguousarray(upright[:, :2])
    facing = _facing(model, points, np.ones(len(points)))
    wall_of_triangle = _walls_edge_on(model, R[2])
    facing[wall_of_triangle >= 0] = EDGE_ON
    wall = wall_of_triangle[model.sides].max(axis=1)
    return Projection(points, upright[:, 2], 1.0, R[2], False, facing, matrix, wall, None)


def seen_by_camera(model: ViewModel, T_world_part: FloatArray, camera: Camera) -> Projection:
    """Return a posed part projected through a camera, lens distortion left out.

    Parameters
    ----------
    model : the part
    T_world_part : (4, 4) pose of the CAD frame in the world [mm]
    camera : calibrated; its distortion waits for `Projection.to_view`

    Raises
    ------
    ValueError : part of it is not in front of the camera
    """
    T_cam_part = inverse_pose(camera.T_world_cam) @ T_world_part
    p_cam_mm = transform(T_cam_part, model.vertices_mm)
    depth = p_cam_mm[:, 2]
    if not (depth > 0).all():
        raise ValueError(
            f"{model.solid.name}: reaches {-depth.min():.1f} mm behind the camera's centre; "
            "a view needs the whole part in front of it"
        )
    focal = float(camera.K[0, 0])
    points = p_cam_mm[:, :2] / depth[:, None] * (focal, -focal)
    matrix = np.diag([focal, -focal, 1.0]) @ T_cam_part[:3]
    eye = transform(inverse_pose(T_cam_part), np.zeros((1, 3)))[0]
    facing = _facing(model, points, focal / depth)
    scale = focal / float(depth.mean())
    wall = np.full(len(model.ends), -1, dtype=np.int32)
    return Projection(points, 1.0 / depth, scale, eye, True, facing, matrix, wall, camera)


def _walls_edge_on(model: ViewModel, direction: FloatArray) -> Int32Array:
    """Return the face of each triangle (t,) if it is a cylinder seen along its axis, else -1.

    A mesh may round the two rims of a bore with different corners. The facets of its wall then lean
    a little to the eye or away from it, and the rims cross each other at every corner; the real
    part has no such crossings.
    """
    faces = model.solid.faces
    of_face = np.full(len(faces), -1, dtype=np.int32)
    round_ones = np.array([f.id for f in faces if f.kind == "cylinder"], dtype=np.int32)
    if len(round_ones):
        axes = np.array([faces[i].axis for i in round_ones.tolist()])
        off_axis = np.linalg.norm(np.cross(axes, direction), axis=1)
        is_along = off_axis < ALONG_RAD
        of_face[round_ones[is_along]] = round_ones[is_along]
    found: Int32Array = of_face[model.solid.face_of_triangle]
    return found


def _facing(model: ViewModel, points: FloatArray, scale: FloatArray) -> NDArray[np.int8]:
    x, y = points[model.triangles, 0].T, points[model.triangles, 1].T  # (3, t)
    double_area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    limit = np.maximum(EDGE_ON_MM, EDGE_ON_RAD * model.heights_mm)
    facing: NDArray[np.int8] = np.sign(double_area).astype(np.int8)
    # no side shows much longer than it is: most are clear without measuring what is seen of it
    local = scale[model.triangles[:, 0]]
    doubtful = np.flatnonzero(np.abs(double_area) < 10 * limit * model.longest_mm * local**2)
    x, y, local = x[:, doubtful], y[:, doubtful], local[doubtful]
    squares = (x[[1, 2, 0]] - x) ** 2 + (y[[1, 2, 0]] - y) ** 2
    height = np.abs(double_area[doubtful]) / np.sqrt(np.maximum(squares.max(axis=0), 1e-300))
    facing[doubtful[height <= limit[doubtful] * local]] = EDGE_ON
    return facing
