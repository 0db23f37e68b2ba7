"""Pictures of one scene under several lamps merged into one for segmentation.

A shadow is where one lamp does not reach, and others mostly do; a side that is as dark as the table
under one lamp is bright under another. The brightest picture of each place has neither.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from controller.arrays import Grey
from controller.imaging.levels import level_step

MAX_GAIN = 3.0  # largest gain of a dim picture; beyond it noise would be brightest
EVERY_PX = 8  # step in rows and columns, for a picture's typical level


def brightest_of(pictures: Sequence[Grey]) -> Grey:
    """Return the brightest value of each pixel, with the pictures scaled to one table level.

    Parameters
    ----------
    pictures : (height, width) each, of one scene by one camera, under other lamps; one at least
    """
    typical = [max(float(np.median(one[::EVERY_PX, ::EVERY_PX])), 1.0) for one in pictures]
    level = float(np.median(typical))
    scaled = [
        cv2.convertScaleAbs(one, alpha=float(np.clip(level / own, 1.0 / MAX_GAIN, MAX_GAIN)))
        for one, own in zip(pictures, typical, strict=True)
    ]
    out = scaled[0]
    for one in scaled[1:]:
        out = cv2.max(out, one)
    # few levels are to stay few, or their steps would be taken for borders
    step = min(
        level_step(np.bincount(one.ravel(), minlength=256).astype(np.float64)) for one in pictures
    )
    if step > 1:
        levels = np.arange(256)
        table = np.clip((levels + step // 2) // step * step, 0, 256 - step).astype(np.uint8)
        out = cv2.LUT(out, table)
    return np.asarray(out, np.uint8)
