"""Whether a view shows how a part is held: its outline stands before something else than the arm.

The first view of a new grasp verifies it, by the outline before the panel. A part that is held up
right in front of the arm shows every face that looks to the camera, and no outline.
"""

from typing import Final

import cv2
import numpy as np

from controller.arrays import FloatArray
from controller.imaging import transform

from ..disambiguation import box_caster
from ..model import CellLayout
from ..motion import Scene

# Share of the outline that has to be clear of the arm. Of 61 first views in plans of five parts the
# least had 0.35; all verified their grasps.
CLEAR_SHARE: Final = 0.3
BESIDE_PX: Final = 4.0  # a point beside the outline has to show what is behind it
RIM_COUNT: Final = 72  # points of the outline that are looked at


def shows_outline(
    layout: CellLayout, scene: Scene, q: FloatArray, hull_mm: FloatArray, T_world_part: FloatArray
) -> bool:
    """Return True if the outline of a part is seen in a view.

    Parameters
    ----------
    layout : the cell
    scene : the arm with the part
    q : (6,) joints of the arm
    hull_mm : (n, 3) vertices of the part's convex hull, CAD frame
    T_world_part : (4, 4) pose of the part then
    """
    camera = layout.inspection
    rim = _rim(camera.project(transform(T_world_part, hull_mm)))
    width, height = camera.size_px
    in_picture = ((rim > 0) & (rim < (width, height))).all(axis=1)
    arm = box_caster(scene.arm_boxes(q))
    clear = in_picture & ~arm.blocked(camera.position_mm, camera.sight_lines(rim))
    return float(clear.mean()) >= CLEAR_SHARE


def _rim(pixels: FloatArray) -> FloatArray:
    """Return points (k, 2) just outside the convex hull of some pixels (n, 2)."""
    hull = cv2.convexHull(pixels.astype(np.float32))[:, 0].astype(np.float64)
    ends = np.roll(hull, -1, axis=0)
    length = np.linalg.norm(ends - hull, axis=1)
    at = np.linspace(0.0, length.sum(), RIM_COUNT, endpoint=False)
    side = np.minimum(np.searchsorted(np.cumsum(length), at, side="right"), len(hull) - 1)
    share = (at - np.concatenate([[0.0], np.cumsum(length)])[side]) / np.maximum(length[side], 1e-9)
    points = hull[side] + share[:, None] * (ends - hull)[side]
    away = points - hull.mean(axis=0)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    return np.asarray(points + BESIDE_PX * away)
