"""The camera model: pin-hole with OpenCV's lens distortion, posed in the world.

Camera frame as OpenCV's: x right, y down, z along the view. Pixel (0, 0) is the centre of the
first pixel.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from controller.arrays import Float32Array, FloatArray

FEW: Final = 64  # points that are transformed sooner than laid out


def transform(T: FloatArray, points: FloatArray) -> FloatArray:
    """Return points (n, 3) taken through the pose ``T`` (4, 4)."""
    if len(points) < FEW:
        return points @ T[:3, :3].T + T[:3, 3]
    # as BLAS likes its matrix, and without a second array: a tenth of the time for 10 000 points
    out: FloatArray = points @ np.ascontiguousarray(T[:3, :3].T)
    for k in range(3):
        out[:, k] += T[k, 3]
    return out


def inverse_pose(T: FloatArray) -> FloatArray:
    """Return the inverse of a rigid pose (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def rotation_angle(R: FloatArray) -> float:
    """Return the angle of a rotation (3, 3) about its own axis [rad]."""
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera.

    Attributes
    ----------
    size_px : (width, height)
    K : (3, 3) camera matrix [px]
    distortion : (5,) k1 k2 p1 p2 k3, OpenCV's
    T_world_cam : (4, 4) pose of the camera in the world [mm]
    """

    size_px: tuple[int, int]
    K: FloatArray
    distortion: FloatArray
    T_world_cam: FloatArray

    @property
    def position_mm(self) -> FloatArray:
        """Centre of projection in the world, (3,)."""
        position: FloatArray = self.T_world_cam[:3, 3]
        return position

    def project(self, p_world_mm: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of world points (n, 3), lens distortion included."""
        # Not by OpenCV, which works out derivatives each time: that takes five times as long. Its
        # rotation vectors also round angles within 1e-5 rad of 0 or pi, which is 0.03 px for a
        # camera that looks almost straight down.
        p_cam_mm = transform(self._world_in_camera, np.asarray(p_world_mm, np.float64))
        x, y, depth = p_cam_mm.T
        depth = np.where(depth == 0.0, 1.0, depth)  # as OpenCV has it
        x, y = x / depth, y / depth
        k1, k2, p1, p2, k3 = self.distortion.tolist()
        xx, yy, xy = x * x, y * y, x * y
        r2 = xx + yy
        radial = ((k3 * r2 + k2) * r2 + k1) * r2 + 1.0
        pixels = np.empty((len(x), 2))
        pixels[:, 0] = x * radial + 2 * p1 * xy + p2 * (r2 + 2 * xx)
        pixels[:, 1] = y * radial + p1 * (r2 + 2 * yy) + 2 * p2 * xy
        pixels *= self.K[[0, 1], [0, 1]]
        pixels += self.K[:2, 2]
        return pixels

    @cached_property
    def _world_in_camera(self) -> FloatArray:
        return inverse_pose(self.T_world_cam)

    def sight_lines(self, pixels: FloatArray) -> FloatArray:
        """Return the directions (n, 3) in the world, scaled to depth 1, of pixels (n, 2)."""
        # By default undistortPoints stops after 5 steps, which costs 1e-3 px near a corner.
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-9)
        plane = cv2.undistortPoints(
            np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2),
            self.K,
            self.distortion,
            None,
            None,
            None,
            criteria,
        ).reshape(-1, 2)
        d_cam = np.column_stack([plane, np.ones(len(plane))])
        d_world: FloatArray = d_cam @ self.T_world_cam[:3, :3].T
        return d_world

    @cached_property
    def sight_line_table(self) -> Float32Array:
        """Directions (height, width, 3) in the world, scaled to depth 1, of all pixels."""
        width, height = self.size_px
        v, u = np.mgrid[0:height, 0:width]
        pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
        return self.sight_lines(pixels).reshape(height, width, 3).astype(np.float32)

    def on_plane(self, pixels: FloatArray, height_mm: float = 0.0) -> FloatArray:
        """Return the points (n, 3) where sight lines of pixels (n, 2) meet the plane z = height."""
        d = self.sight_lines(pixels)
        s = (height_mm - self.position_mm[2]) / d[:, 2]
        points: FloatArray = self.position_mm + s[:, None] * d
        return points

    def mm_per_px(self, p_world_mm: FloatArray) -> float:
        """Return the size of a pixel [mm] at the depth of a world point (3,)."""
        depth = float((p_world_mm - self.position_mm) @ self.T_world_cam[:3, 2])
        return depth / float(self.K[0, 0])
