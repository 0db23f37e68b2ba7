"""The area of a code on a face: marked on purpose, and so compared with nothing (ADR 129)."""

from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray

# Border of a code that belongs to it, in its own width: the quiet zone of a QR code of 21 modules
# is four of them, and the ground of a label reaches at least as far.
QUIET_SHARE: Final = 4 / 21
# How far off its corners may be, in the plane and out of it: a pixel of the camera over the table,
# and twice the error of a pose.
OFF_MM: Final = 0.8


def on_code(points_mm: FloatArray, corners_mm: FloatArray) -> BoolArray:
    """Return a mask (n,) of the points on a code, its quiet zone with it.

    Parameters
    ----------
    points_mm : (n, 3) points of the part
    corners_mm : (4, 3) corners of the code in turn, same frame
    """
    first, second, third, fourth = corners_mm
    across, along = (second + third - first - fourth) / 2, (third + fourth - first - second) / 2
    normal = np.cross(across, along)
    off = points_mm - corners_mm.mean(axis=0)
    # sides of a code that is seen at a slant are not square to each other by some degrees
    place = off @ np.linalg.pinv(np.vstack((across, along, normal)))
    reach = 0.5 + QUIET_SHARE + OFF_MM / np.linalg.norm((across, along), axis=1)
    is_level = np.abs(place[:, 2]) * np.linalg.norm(normal) <= OFF_MM
    return np.asarray(is_level & (np.abs(place[:, :2]) <= reach).all(axis=1))
