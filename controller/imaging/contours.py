"""Outlines of dark objects in front of a bright ground, to a fraction of a pixel.

In an anti-aliased picture the edge lies at the level halfway between ground and object.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey, IntArray

from .loops import evenly, loop_normals, trace_loops

MIN_CHAIN_PX = 8  # a shorter outline belongs to a speck
# Share of the ground's level: a light table stays above it at its rim, an object below it.
DARK_SHARE = 0.6


@dataclass(frozen=True, eq=False, slots=True)
class Contour:
    """Points of an outline.

    Attributes
    ----------
    points_px : (n, 2) x before y
    normals : (n, 2) unit, from the object to the ground
    """

    points_px: FloatArray
    normals: FloatArray


def threshold_levels(image: NDArray[np.uint8], inside: BoolArray) -> tuple[float, float, float]:
    """Return (object level, half level, ground level) of a backlit picture within a mask.

    Otsu's cut comes first; the two levels are the medians on its two sides. A small object on a
    ground that fades towards its rim makes Otsu cut the ground in two: then only much darker areas
    count as object. Without an object, its level is that of the ground.
    """
    values = image[inside]
    cut, _ = cv2.threshold(values.reshape(1, -1), 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    levels, counts = np.arange(256), np.bincount(values, minlength=256)
    is_dark = levels <= cut
    is_bright = ~is_dark if counts[~is_dark].any() else is_dark
    high = _median_level(np.where(is_bright, counts, 0))
    low = _median_level(np.where(is_dark, counts, 0)) if counts[is_dark].any() else high
    if low > DARK_SHARE * high:
        high = _median_level(counts)
        is_dark = levels <= DARK_SHARE * high
        low = _median_level(np.where(is_dark, counts, 0)) if counts[is_dark].any() else high
    return low, 0.5 * (low + high), high


def _median_level(counts: IntArray) -> float:
    """Return the median of grey levels by their counts (256,), one at least."""
    below = np.cumsum(counts)
    total = int(below[-1])
    middle = np.searchsorted(below, ((total - 1) // 2, total // 2), side="right")
    return float(middle.mean())


def mask_rim(mask: BoolArray) -> BoolArray:
    """Return the border of a mask (height, width): pixels next to the outside or to the edge."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
    return np.asarray(mask & (inner == 0))


def mask_contour(mask: BoolArray) -> FloatArray:
    """Return all border pixels of a mask, outer and inner, (n, 2) x before y."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not found:
        return np.zeros((0, 2))
    return np.vstack([c.reshape(-1, 2) for c in found]).astype(np.float64)


def subpixel_contour(image: Grey | Float32Array, level: float) -> Contour:
    """Return the outlines of everything darker than a grey level, about one point per pixel.

    Parameters
    ----------
    image : (height, width) grey, or brightness in any unit
    level : level of the edge, in the same
    """
    mask = (image < level).astype(np.uint8)
    found, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    chains = [np.asarray(chain, np.int32) for chain in found if len(chain) >= MIN_CHAIN_PX]
    if not chains:
        return Contour(np.zeros((0, 2)), np.zeros((0, 2)))
    field = np.float32(level) - image.astype(np.float32)
    loops = [evenly(loop) for loop in trace_loops(chains, mask.shape, field, (0, 0))]
    # OpenCV's outlines have negative signed area round objects and positive round holes
    normals = [-loop_normals(loop) for loop in loops]
    return Contour(np.concatenate(loops), np.concatenate(normals))
