"""Outlines to a fraction of a pixel: ordered crossings of the half level between both sides.

A field that is positive on the object is given at the pixels. Its zero line meets the raster's
lines between an object pixel and a neighbour that is none; those crossings in the order of the
pixel contour are the outline (marching squares, in arrays).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

# the eight neighbours anticlockwise to the eye, from the one on the right (Freeman)
STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
STEP_Y = np.array([0, -1, -1, -1, 0, 1, 1, 1])
CODE = np.zeros((3, 3), dtype=np.int64)
CODE[STEP_Y + 1, STEP_X + 1] = np.arange(8)


def trace_loops(mask: Mask, field: Floats, origin_px: tuple[int, int]) -> list[Array]:
    """Return closed outlines of one object, the outer one first, then holes by size.

    Parameters
    ----------
    mask : (h, w) one connected object
    field : (h, w) positive inside, negative outside, straight through zero near the border;
        where its signs do not agree with the mask the border is half-way between the pixels
    origin_px : x, y of the mask's first pixel in the picture

    Returns
    -------
    list of (n, 2), x before y, picture pixels, about one point a pixel, evenly spread
    """
    chains, tree = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not chains:
        return []
    is_hole = tree[0, :, 3] >= 0
    order = sorted(range(len(chains)), key=lambda i: (is_hole[i], -len(chains[i])))
    return [_crossings(chains[i].reshape(-1, 2), mask, field) + origin_px for i in order]


def _crossings(chain: NDArray[np.int32], mask: Mask, field: Floats) -> Array:
    """Return where the border crosses raster lines along a chain of border pixels."""
    height, width = mask.shape
    if len(chain) == 1:
        codes = np.array([[0, 2, 4, 6]])
        swept = np.ones((1, 4), dtype=np.bool_)
    else:
        back = np.roll(chain, 1, axis=0) - chain
        ahead = np.roll(chain, -1, axis=0) - chain
        first = CODE[back[:, 1] + 1, back[:, 0] + 1]
        last = CODE[ahead[:, 1] + 1, ahead[:, 0] + 1]
        turn = (last - first) % 8
        turn[turn == 0] = 8
        # the ground lies to the right of the way: between back and ahead, anticlockwise
        sweep = np.arange(1, 8)
        codes = (first[:, None] + sweep) % 8
        swept = (sweep < turn[:, None]) & (codes % 2 == 0)
    row, which = np.nonzero(swept)
    code = codes[row, which]
    x, y = chain[row, 0].astype(np.int64), chain[row, 1].astype(np.int64)
    nx, ny = x + STEP_X[code], y + STEP_Y[code]
    is_inside = (nx >= 0) & (ny >= 0) & (nx < width) & (ny < height)
    nx_in, ny_in = np.clip(nx, 0, width - 1), np.clip(ny, 0, height - 1)
    here = field[y, x].astype(np.float64)
    there = field[ny_in, nx_in].astype(np.float64)
    crosses = is_inside & (here > 0) & (there <= 0)
    part = np.where(crosses, here / np.where(crosses, here - there, 1.0), 0.5)
    return np.column_stack([x + part * (nx - x), y + part * (ny - y)])


def polygon_area(points: Array) -> float:
    """Return the area inside a closed polygon (n, 2)."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def evenly(points: Array) -> Array:
    """Return a closed outline at points one apart, or nearly, along it."""
    closed = np.vstack([points, points[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    count = max(round(float(along[-1])), 4)
    at = np.arange(count) * (along[-1] / count)
    return np.column_stack([np.interp(at, along, closed[:, 0]), np.interp(at, along, closed[:, 1])])
