"""Outlines traced to a fraction of a pixel: the ordered crossings of the half level.

The input is a field at the pixels, positive on the object. Its zero line crosses the raster's lines
between a pixel on the object and a neighbour that is not on it. These crossings, in the order of
the pixel contour, are the outline (marching squares, in arrays).
"""

from collections.abc import Sequence

import numpy as np

from controller.arrays import Float32Array, FloatArray, IndexArray, Int32Array

# The eight neighbours, anticlockwise as seen in the picture, from the right one on (Freeman).
STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
STEP_Y = np.array([0, -1, -1, -1, 0, 1, 1, 1])
CODE = np.zeros((3, 3), dtype=np.intp)
CODE[STEP_Y + 1, STEP_X + 1] = np.arange(8)


def _swept() -> IndexArray:
    """Return (64, 4) the neighbours beside a chain, by its steps back and ahead; -1 for none.

    The ground lies to the right of the chain: between back and ahead, anticlockwise.
    """
    table = np.full((64, 4), -1, dtype=np.intp)
    for back in range(8):
        for ahead in range(8):
            turn = (ahead - back) % 8 or 8
            codes = [(back + k) % 8 for k in range(1, turn) if (back + k) % 2 == 0]
            table[back * 8 + ahead, : len(codes)] = codes
    return table


SWEPT = _swept()
SWEPT_ALL = np.array([0, 2, 4, 6])  # the neighbours of a single pixel


def trace_loops(
    chains: Sequence[Int32Array],
    shape: tuple[int, ...],
    field: Float32Array,
    origin_px: tuple[int, int],
) -> list[FloatArray]:
    """Return closed outlines of one object, the outer one first, then holes by size.

    Parameters
    ----------
    chains : (n, 1, 2) pixels along its borders as OpenCV finds them, the outer one first
    shape : (h, w) shape of the raster
    field : (h, w) positive inside, negative outside, linear near the border; where its signs
        disagree with the mask, the border is half-way between the pixels
    origin_px : x, y of the raster's first pixel in the picture

    Returns
    -------
    list of (n, 2), x before y, picture pixels, about one point per pixel, evenly spread
    """
    ordered = [chains[0], *sorted(chains[1:], key=lambda chain: -len(chain))]
    length = np.array([len(chain) for chain in ordered])
    ends = np.cumsum(length)
    x, y = np.concatenate(ordered).reshape(-1, 2).T.astype(np.intp)
    # each chain is closed: its first pixel follows its last one
    after = np.arange(1, len(x) + 1)
    after[ends - 1] = ends - length
    ahead = CODE[y[after] - y + 1, x[after] - x + 1]
    back = np.empty_like(ahead)
    back[after] = (ahead + 4) % 8
    which = SWEPT[back * 8 + ahead]
    which[ends[length == 1] - 1] = SWEPT_ALL
    row, column = np.nonzero(which >= 0)
    code = which[row, column]
    loops = _crossings(x[row], y[row], code, shape, field) + origin_px
    return np.split(loops, np.searchsorted(row, ends[:-1]))


def _crossings(
    x: IndexArray, y: IndexArray, code: IndexArray, shape: tuple[int, ...], field: Float32Array
) -> FloatArray:
    """Return the points where the border crosses the raster lines between neighbouring pixels."""
    height, width = shape
    dx, dy = STEP_X[code], STEP_Y[code]
    nx, ny = x + dx, y + dy
    is_inside = (nx >= 0) & (ny >= 0) & (nx < width) & (ny < height)
    values = field.ravel()
    at = y * width + x
    here = values[at]
    there = values[np.where(is_inside, at + dy * width + dx, at)]
    crosses = (here > 0) & (there <= 0)
    part = np.where(crosses, here / np.where(crosses, here - there, 1.0), 0.5)
    return np.column_stack([x + part * dx, y + part * dy])


def signed_area(points: FloatArray) -> float:
    """Return the area inside a closed polygon (n, 2), positive if it runs from x to y."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def loop_normals(loop: FloatArray) -> FloatArray:
    """Return unit normals (n, 2) of a dense closed loop, to the outside if its area is positive."""
    tangent = np.roll(loop, -2, axis=0) - np.roll(loop, 2, axis=0)
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9))


def evenly(points: FloatArray) -> FloatArray:
    """Return a closed outline resampled at points about 1 apart along it."""
    closed = np.concatenate([points, points[:1]])
    way = closed[1:] - closed[:-1]
    along = np.zeros(len(closed))
    np.cumsum(np.sqrt(way[:, 0] * way[:, 0] + way[:, 1] * way[:, 1]), out=along[1:])
    count = max(round(float(along[-1])), 4)
    at = np.arange(count) * (along[-1] / count)
    return np.column_stack([np.interp(at, along, closed[:, 0]), np.interp(at, along, closed[:, 1])])
