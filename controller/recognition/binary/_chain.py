"""The boundary of a mask as a 4-way chain: the cracks between pixels, and its turns.

The paper (references.md P3.1) encodes each binary object by the first difference of Freeman's 4-way
chain code. The chain here runs along the cracks between object and ground and not through pixel
centres: then an outer boundary and a hole are of one kind, a line one pixel thick needs no
turning back, and the shoelace area is the pixel count exactly.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, ByteArray, FloatArray, IntArray

# Freeman's steps, x before y with y down: right, up, left, down to the eye.
STEPS = np.array([[1, 0], [0, -1], [-1, 0], [0, 1]], dtype=np.int64)


@dataclass(frozen=True, eq=False, slots=True)
class Chain:
    """A closed boundary with the object on its left.

    Anticlockwise to the eye round an object, clockwise round a hole.

    Attributes
    ----------
    start_px : (2,) start, x before y; a corner between four pixels, so half-integer
    codes : (n,) Freeman directions of its cracks: 0 right, 1 up, 2 left, 3 down
    area_px : enclosed area, negative for a hole; the sum over all chains is the pixel count
    """

    start_px: FloatArray
    codes: ByteArray
    area_px: int

    @property
    def is_hole(self) -> bool:
        """True if the ground is inside."""
        return self.area_px < 0

    @property
    def points_px(self) -> FloatArray:
        """(n, 2) corners between pixels on the boundary; crack i leads from point i to the next."""
        steps = STEPS[self.codes]
        return np.asarray(self.start_px + np.cumsum(steps, axis=0) - steps, dtype=np.float64)

    @property
    def middles_px(self) -> FloatArray:
        """(n, 2) middles of its cracks, which lie evenly on both sides of the true edge."""
        return np.asarray(self.points_px + 0.5 * STEPS[self.codes], dtype=np.float64)


def chain_code(mask: BoolArray) -> tuple[Chain, ...]:
    """Return the boundaries of a mask, outer ones by falling area, then holes likewise.

    Pixels that touch at a corner belong together (8 neighbours), as in OpenCV.

    Parameters
    ----------
    mask : (height, width)
    """
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    if width == 0:
        return ()
    inside = np.zeros((height + 2, width + 2), dtype=np.uint8)
    inside[1:-1, 1:-1] = mask[top : top + height, left : left + width]
    # in the lattice of corners between pixels, which is as wide as the padded mask less one
    wide = width + 1
    begin, direction = _cracks(inside, wide)
    order, lengths = _follow(begin, direction, wide)
    begin, direction = begin[order], direction[order]
    x, y = begin % wide, begin // wide
    # y runs down: Green's sum of y dx is the area anticlockwise to the eye
    swept = y * STEPS[direction, 0]
    first = np.cumsum(lengths) - lengths
    area = np.add.reduceat(swept, first)
    codes = direction.astype(np.uint8)
    chains = [
        Chain(
            np.array([x[i] + left - 0.5, y[i] + top - 0.5]),
            codes[i : i + n],
            int(a),
        )
        for i, n, a in zip(first.tolist(), lengths.tolist(), area.tolist(), strict=True)
    ]
    return tuple(sorted(chains, key=lambda chain: (chain.is_hole, -abs(chain.area_px))))


def curvature_code(chain: Chain) -> NDArray[np.int8]:
    """Return the turn at each point of a chain, in right angles: +1 left, -1 right.

    The first difference of its codes, which sums to +4 round an object and to -4 round a hole. A
    boundary of cracks never turns back, so the 2 of chains through pixel centres does not occur.
    """
    codes = chain.codes.astype(np.int64)
    turn = codes - np.concatenate([codes[-1:], codes[:-1]])
    code: NDArray[np.int8] = ((turn + 1) % 4 - 1).astype(np.int8)
    return code


def _cracks(inside: NDArray[np.uint8], wide: int) -> tuple[IntArray, IntArray]:
    """Return start (lattice index) and direction of all cracks, with the object on their left."""
    flat = inside.ravel()
    stride = inside.shape[1]
    upright = np.flatnonzero(flat[:-1] != flat[1:])  # between a pixel and its right neighbour
    level = np.flatnonzero(flat[:-stride] != flat[stride:])  # and the one below
    row, column = upright // stride, upright % stride
    up = flat[upright] > 0  # the object is west of the crack: up it goes, from its lower end
    begins = [np.where(up, row, row - 1) * wide + column]
    directions = [np.where(up, 1, 3)]
    row, column = level // stride, level % stride
    right = flat[level] > 0  # the object is above the crack
    begins.append(row * wide + np.where(right, column - 1, column))
    directions.append(np.where(right, 0, 2))
    return np.concatenate(begins), np.concatenate(directions)


def _follow(begin: IntArray, direction: IntArray, wide: int) -> tuple[IntArray, IntArray]:
    """Return the order of the cracks along their loops, in raster order, and the loops' lengths."""
    key = 4 * begin + direction
    by_key = np.argsort(key)
    key = key[by_key]
    begin, direction = begin[by_key], direction[by_key]
    end = begin + np.array([1, -wide, -1, wide])[direction]
    ahead = np.searchsorted(key, 4 * end)
    # where two pixels meet by a corner two cracks lead on: the right-hand one keeps them together
    other = np.minimum(ahead + 1, len(key) - 1)
    forked = (begin[other] == end) & (other != ahead)
    take = forked & (direction[other] == (direction - 1) % 4)
    following = np.where(take, other, ahead).tolist()
    order: list[int] = []
    lengths: list[int] = []
    is_new = [True] * len(following)
    for seed in range(len(following)):
        if not is_new[seed]:
            continue
        before, at = len(order), seed
        while is_new[at]:
            is_new[at] = False
            order.append(at)
            at = following[at]
        lengths.append(len(order) - before)
    return by_key[np.array(order)], np.array(lengths)
