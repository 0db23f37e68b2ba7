"""Effect of blur on an outline: it rounds corners, fills notches and flattens teeth."""

from typing import Final

import cv2
import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera, inverse_pose, sample_picture, transform

from .._pose import PosedPart
from ..limits import PANEL_HALF

FINE: Final = 4  # samples per pixel in each direction
# Places along the normal where the blurred outline is sought.
ALONG_PX: Final = np.arange(-4.0, 4.05, 0.1)


def blur_rounds_px(
    part: PosedPart,
    T_world_part: FloatArray,
    camera: Camera,
    window: FloatArray,
    sigma_px: float,
    at_px: FloatArray,
    normals: FloatArray,
) -> FloatArray:
    """Return the distance (n,) of a part's blurred outline outside the sharp one [px].

    Parameters
    ----------
    part, T_world_part, camera : the part, its pose, and the camera
    window : (4,) x0, y0, x1, y1 of the blurred portion of the picture
    sigma_px : standard deviation of the blur
    at_px, normals : (n, 2) points of the sharp outline in the window, and its outward normals

    Returns
    -------
    nan where the blurred outline is beyond the reach of the search
    """
    x0, y0, x1, y1 = window
    width, height = (int(np.ceil(FINE * size)) + 1 for size in (x1 - x0, y1 - y0))
    u, v = np.meshgrid(x0 + np.arange(width) / FINE, y0 + np.arange(height) / FINE)
    T_part_world = inverse_pose(T_world_part)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    lines = camera.sight_lines(np.column_stack([u.ravel(), v.ravel()])) @ T_part_world[:3, :3].T
    triangle, _ = part.caster.first_hit(eye, lines)
    mask = (triangle >= 0).reshape(height, width).astype(np.float32)
    soft = cv2.GaussianBlur(mask, (0, 0), FINE * sigma_px, borderType=cv2.BORDER_REPLICATE)
    along = at_px[:, None] + ALONG_PX[None, :, None] * normals[:, None]
    grid = FINE * (along - [x0, y0])
    share = sample_picture(soft, grid[..., 0], grid[..., 1], cv2.BORDER_REPLICATE)
    inside = share >= PANEL_HALF
    leaves = inside[:, :-1] & ~inside[:, 1:]
    middle = 0.5 * (ALONG_PX[:-1] + ALONG_PX[1:])
    away = np.where(leaves, np.abs(middle), np.inf)
    nearest = np.argmin(away, axis=1)
    shift = middle[nearest]
    shift[np.abs(shift) <= 1.0 / FINE] = 0.0  # within the resolution of the samples
    return np.asarray(np.where(leaves.any(axis=1), shift, np.nan))
