"""Corners of a loop from its turns: a triangular filter, a threshold, local peaks.

The paper (references.md P3.1): the filter is two box-cars one after the other, each a running sum,
so that a sample costs four additions whatever the length; its Table 2 lists distance and size.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from controller.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False, slots=True)
class BoundaryCorners:
    """Corners in the order of the boundary.

    Attributes
    ----------
    distance_px : (n,) distance along the boundary from its start; half a pixel where a plateau is
        even
    size : (n,) filter output there, without its sign: a right angle gives the box-car's length
    sign : (n,) +1 where the object juts out, -1 where it is notched
    index : (n,) nearest sample of the boundary
    """

    distance_px: FloatArray
    size: FloatArray
    sign: NDArray[np.int8]
    index: IntArray


def triangular(turns: FloatArray, length: int) -> FloatArray:
    """Return turns (n,) round a loop filtered by a triangle.

    Its height is ``length``, its base 2 ``length`` - 1. The sum of the answer is that of the turns
    times the square of the length.

    Raises
    ------
    ValueError : a box-car shorter than one sample
    """
    if length < 1:
        raise ValueError(f"a box-car of {length} samples, at least 1 is needed")
    if len(turns) == 0:
        return turns
    around = np.take(turns, np.arange(1 - length, len(turns) + length - 1), mode="wrap")
    return _box_car(_box_car(around.astype(np.float64), length), length)


def _box_car(values: FloatArray, length: int) -> FloatArray:
    """Return running sums of ``length`` neighbours: (n - length + 1,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(total[length:] - total[:-length])


def find_corners(filtered: FloatArray, threshold: float, reach: int) -> BoundaryCorners:
    """Return the corners of a boundary: peaks of its filtered curvature, of either sign.

    Parameters
    ----------
    filtered : (n,) of a closed boundary, from `triangular`
    threshold : least size of a corner; of the filter's length l a turn by an angle a gives about
        l a / (pi / 2)
    reach : samples on either side within which a peak is the highest; the filter's length, since
        nearer corners are one hill. Peaks of equal height within the reach are one plateau, whose
        middle counts: slanting lines are stairs, and these make ripples.
    """
    count = len(filtered)
    found: list[tuple[float, float, int]] = []
    if count:
        size = min(2 * reach + 1, count)
        for sign in (1, -1):
            height = sign * filtered
            if not (height >= threshold).any():
                continue
            highest = ndimage.maximum_filter1d(height, size, mode="wrap")
            at = np.flatnonzero((height == highest) & (height >= threshold))
            found += [(m, height[round(m) % count], sign) for m in _plateaus(at, reach, count)]
    found.sort()
    distance = np.array([m for m, _, _ in found])
    return BoundaryCorners(
        distance_px=distance,
        size=np.array([s for _, s, _ in found]),
        sign=np.array([s for _, _, s in found], dtype=np.int8),
        index=np.round(distance).astype(np.int64) % max(count, 1),
    )


def _plateaus(at: IntArray, reach: int, count: int) -> list[float]:
    """Return the middles of groups of samples within the reach of each other, round a loop."""
    gap = np.diff(at, append=at[0] + count)
    last = np.flatnonzero(gap > reach)
    if len(last) == 0:  # all round: no corner stands out
        return []
    ends = at[last]
    starts = at[(last + 1) % len(at)]
    starts = np.roll(starts, 1)
    middle = starts + ((ends - starts) % count) / 2
    return [float(m) for m in np.sort(middle % count)]
