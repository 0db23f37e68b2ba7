"""Measured pictures on the grid of the predictions."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from controller.arrays import BoolArray, Grey
from controller.imaging import mask_rim

from ._pictures import EdgePicture
from ._separate import PredictedPictures

SMOOTH_PX = 1.2
EDGE_NOISES = 8.0  # strength of an edge in noises of the picture; half of it continues one
MIN_STEP_GREY = 8.0


def measured_picture(
    predicted: PredictedPictures, backlit: Grey, lit: Sequence[Grey] = ()
) -> EdgePicture:
    """Return outline and edges of a photographed part.

    Edges far from those of every hypothesis, on the arm gripper or behind the part, do not
    distinguish the hypotheses and are left out.

    Parameters
    ----------
    predicted : of `predict_view` with a grid of every pixel
    backlit : (height, width) against the backlight panel
    lit : under one lamp each

    Raises
    ------
    ValueError : the predictions are thinned; or neither a dark part nor a bright panel is there
    """
    first = predicted.pictures[0]
    if first.step_px != 1:
        raise ValueError(f"pictures are compared on every pixel, not on every {first.step_px}th")
    x0, y0, x1, y1 = predicted.roi
    mask = _dark(backlit[y0:y1, x0:x1])
    edges = np.zeros_like(mask)
    for grey in lit:
        edges |= _steps(grey[y0:y1, x0:x1])
    edges |= mask_rim(mask)
    known = np.any([p.edges for p in predicted.pictures], axis=0)
    near = predicted.stance.shift_px + predicted.stance.tolerance_px
    away = cv2.distanceTransform((~known).astype(np.uint8), cv2.DIST_L2, 5)
    none = np.zeros_like(mask)
    return EdgePicture(1, mask, edges & (away <= near), none, none)


def _dark(grey: Grey) -> BoolArray:
    """Return the mask of everything in front of the backlight."""
    level, _ = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    dark = np.asarray(grey <= level)
    if not 0 < dark.sum() < dark.size:
        raise ValueError("a picture against the light needs a dark part before a bright panel")
    return dark


def _steps(grey: Grey) -> BoolArray:
    """Return the edges of one picture, thinned to lines."""
    smooth = cv2.GaussianBlur(grey, (0, 0), SMOOTH_PX)
    rough = np.abs(grey.astype(np.float32) - smooth)
    noise = 1.5 * float(np.median(rough))
    # Sobel's kernel answers a step of one grey level with four
    high = 4.0 * max(MIN_STEP_GREY, EDGE_NOISES * noise / (2.0 * SMOOTH_PX))
    return np.asarray(cv2.Canny(smooth, high / 2, high) > 0)
