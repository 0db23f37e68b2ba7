"""The hull of all edges as one feature: for parts without a straight line or a circle.

A wavy or twisted part alone in its crop has no feature for the paper's corner-line-corner, but it
has a size, a middle and a long axis. Shadows and neighbours spoil these; then the other features
decide.
"""

import cv2
import numpy as np

from controller.arrays import FloatArray

ROUNDEST = 0.85  # ratio of half axes above which the long axis is unreliable


def hull_of(points: FloatArray) -> FloatArray | None:
    """Return (6,) centre x y, root of area, turn of the long way, ratio of axes, reach; or None."""
    if len(points) < 6:
        return None
    hull = cv2.convexHull(np.asarray(points, dtype=np.float32))
    m = cv2.moments(hull)
    if m["m00"] < 1.0:
        return None
    x, y = m["m10"] / m["m00"], m["m01"] / m["m00"]
    xx, xy, yy = m["mu20"] / m["m00"], m["mu11"] / m["m00"], m["mu02"] / m["m00"]
    half, mean = np.hypot((xx - yy) / 2, xy), (xx + yy) / 2
    ratio = np.sqrt(max(mean - half, 0.0) / (mean + half))
    turn = 0.5 * np.arctan2(2 * xy, xx - yy)
    reach = np.linalg.norm(hull[:, 0] - np.array([x, y]), axis=1).max()
    return np.array([x, y, np.sqrt(m["m00"]), turn, ratio, reach])
