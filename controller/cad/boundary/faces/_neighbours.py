"""Pairs of facets that meet smoothly, and the pairs of these that share a long side."""

import numpy as np

from controller.arrays import BoolArray, IntArray

from ...graph import distinct
from ._facets import Facets

LONG_SIDE = 0.5  # share of a facet's longest side; strips of a wall meet along such sides


class SmoothNeighbours:
    """Facets that meet smoothly, as rows of a compressed adjacency.

    Parameters
    ----------
    count : number of all facets
    a, b : (n,) facets that meet, pair by pair; either may come first, and a pair may come twice
    """

    def __init__(self, count: int, a: IntArray, b: IntArray) -> None:
        key = distinct(np.concatenate([a * count + b, b * count + a]))
        self.to: IntArray = key % count
        self.start = np.searchsorted(key // count, np.arange(count + 1))

    def of(self, facets: IntArray) -> IntArray:
        """Return the neighbours of facets, with repeats."""
        return np.asarray(self.to[rows(self.start, facets)])


def along_long_sides(facets: Facets, inner: BoolArray) -> SmoothNeighbours:
    """Return the neighbours across long sides: strip by strip round a wall, not off its ends."""
    a, b, lengths = facets.a[inner], facets.b[inner], facets.lengths_mm[inner]
    longest = np.zeros(facets.count)
    np.maximum.at(longest, a, lengths)
    np.maximum.at(longest, b, lengths)
    long = lengths > LONG_SIDE * np.maximum(longest[a], longest[b])
    return SmoothNeighbours(facets.count, a[long], b[long])


def rows(start: IntArray, picked: IntArray) -> IntArray:
    """Return the positions of all entries of picked rows of a compressed table."""
    begin = start[picked]
    sizes = start[picked + 1] - begin
    ends = sizes.cumsum()
    total = int(ends[-1]) if len(ends) else 0
    return np.asarray(np.arange(total) + np.repeat(begin - ends + sizes, sizes), dtype=np.int64)
