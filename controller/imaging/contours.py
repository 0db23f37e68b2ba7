"""Outlines of dark objects before a bright ground, to a fraction of a pixel.

The half level between ground and object is where the edge of an anti-aliased picture lies; each
contour pixel slides along the grey-level gradient to where the picture crosses that level.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray

REACH_PX = 2.5  # how far along the gradient a crossing is looked for
STEP_PX = 0.25
DARK_SHARE = 0.6  # of the ground's level: no glowing plate fades by more, no object glows so much


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

    Otsu's cut first; the two levels are the medians on its sides. A small object on a ground that
    fades to its rim makes Otsu cut the ground in two: then only what is much darker counts. Object
    and ground level are one where nothing is.
    """
    values = image[inside]
    cut, _ = cv2.threshold(values.reshape(1, -1), 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    dark, bright = values[values <= cut], values[values > cut]
    high = float(np.median(bright if len(bright) else dark))
    low = float(np.median(dark)) if len(dark) else high
    if low > DARK_SHARE * high:
        high = float(np.median(values))
        dark = values[values <= DARK_SHARE * high]
        low = float(np.median(dark)) if len(dark) else high
    return low, 0.5 * (low + high), high


def mask_contour(mask: BoolArray) -> FloatArray:
    """Return all border pixels of a mask, outer and inner, (n, 2) x before y."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not found:
        return np.zeros((0, 2))
    return np.vstack([c.reshape(-1, 2) for c in found]).astype(np.float64)


def subpixel_contour(image: NDArray[np.uint8], mask: BoolArray, level: float) -> Contour:
    """Return the outline of a dark object at a grey level.

    Parameters
    ----------
    image : (height, width) grey
    mask : (height, width) the object, to a pixel
    level : grey level of the edge
    """
    start = mask_contour(mask)
    if len(start) == 0:
        return Contour(np.zeros((0, 2)), np.zeros((0, 2)))
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32)
    gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    xi, yi = start[:, 0].astype(int), start[:, 1].astype(int)
    gradient = np.column_stack([gx[yi, xi], gy[yi, xi]]).astype(np.float64)
    strength = np.linalg.norm(gradient, axis=1)
    keep = strength > 1.0
    start, gradient = start[keep], gradient[keep] / strength[keep][:, None]
    offsets = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX)
    where = start[:, None, :] + offsets[None, :, None] * gradient[:, None, :]
    profile = cv2.remap(
        image,
        where[..., 0].astype(np.float32),
        where[..., 1].astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    ).astype(np.float64)
    rises = (profile[:, :-1] < level) & (profile[:, 1:] >= level)
    # of several crossings the one nearest to the pixel it began at
    cost = np.where(rises, np.abs(offsets[:-1] + STEP_PX / 2), np.inf)
    first = np.argmin(cost, axis=1)
    rows = np.arange(len(start))
    good = np.isfinite(cost[rows, first])
    low, high = profile[rows, first], profile[rows, first + 1]
    fraction = np.where(high > low, (level - low) / np.maximum(high - low, 1e-9), 0.5)
    along = offsets[first] + fraction * STEP_PX
    points = start + along[:, None] * gradient
    return Contour(points[good], gradient[good])
