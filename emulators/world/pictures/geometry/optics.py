"""A camera's rays: OpenCV's lens model and its inverse, for pixels and fractions of pixels."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...layout import CameraLayout
from ...poses import invert, transform
from ...shapes import Array

Array32 = NDArray[np.float32]

_UNDISTORT_STEPS: Final = 6  # each gains two digits at the lens' 1 % of distortion
_CHUNK: Final = 8_192  # points at a time, so that their data stay in the processor's cache


def distort(xy: Array, distortion: Array) -> Array:
    """Return normalised coordinates as the lens distorts them, (n, 2) -> (n, 2); OpenCV's model."""
    return np.stack(_distorted(xy[..., 0], xy[..., 1], distortion), axis=-1)


def _distorted(x: Array, y: Array, distortion: Array) -> tuple[Array, Array]:
    k1, k2, p1, p2, k3 = (float(v) for v in distortion[:5])
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return x * radial + dx, y * radial + dy


def undistort(xy: Array, distortion: Array) -> Array:
    """Return the normalised coordinates that the lens puts at ``xy``, (n, 2) -> (n, 2)."""
    found = np.empty_like(xy)
    for start in range(0, len(xy), _CHUNK):
        part = slice(start, start + _CHUNK)
        wanted_x, wanted_y = (np.ascontiguousarray(column) for column in xy[part].T)
        x, y = wanted_x.copy(), wanted_y.copy()
        for _ in range(_UNDISTORT_STEPS):
            bent_x, bent_y = _distorted(x, y, distortion)
            x += wanted_x - bent_x
            y += wanted_y - bent_y
        found[part, 0], found[part, 1] = x, y
    return found


def project(camera: CameraLayout, points_mm: Array) -> tuple[Array, Array]:
    """Return pixels (n, 2) and depths (n,) [mm] of world points (n, 3)."""
    seen = transform(invert(camera.T_world_cam), points_mm)
    depth = seen[:, 2]
    xy = distort(
        seen[:, :2] / np.where(np.abs(depth) < 1e-9, 1e-9, depth)[:, None], camera.distortion
    )
    return xy * camera.focal_px + np.array(camera.centre_px), depth


class RayTable:
    """Directions in the world of all pixels of a camera; their component along its axis is 1.

    Within a pixel the direction is linear in the offset: the lens bends by 1e-8 over a pixel.
    """

    def __init__(self, camera: CameraLayout) -> None:
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        pixels = np.stack((u, v), axis=-1).reshape(-1, 2).astype(float)
        xy = undistort((pixels - camera.centre_px) / camera.focal_px, camera.distortion)
        plane = xy.reshape(camera.height_px, camera.width_px, 2)
        self._du = _slope(plane, 1)
        self._dv = _slope(plane, 0)
        R = camera.T_world_cam[:3, :3]
        self.origin_mm = camera.T_world_cam[:3, 3].astype(np.float32)
        self._across = np.ascontiguousarray(R[:, :2].T, dtype=np.float32)
        self.directions: Array32 = (xy @ R[:, :2].T + R[:, 2]).astype(np.float32)

    def fractions(self, pixels: NDArray[np.intp], offsets: Array32) -> Array32:
        """Return directions through points inside pixels, (n * k, 3), pixel by pixel.

        Parameters
        ----------
        pixels : (n,) flat numbers, row by row
        offsets : (k, 2) offsets of the points from the pixel's centre [px]
        """
        du, dv = self._du[pixels] @ self._across, self._dv[pixels] @ self._across
        fine = self.directions[pixels][:, None] + du[:, None] * offsets[None, :, :1]
        fine += dv[:, None] * offsets[None, :, 1:]
        flat: Array32 = fine.reshape(-1, 3)
        return flat


def _slope(plane: Array, axis: int) -> Array32:
    """Return the change of directions from pixel to pixel, (h, w, 2) -> (h * w, 2)."""
    slope: Array = np.asarray(np.gradient(plane, axis=axis))
    return slope.reshape(-1, 2).astype(np.float32)
