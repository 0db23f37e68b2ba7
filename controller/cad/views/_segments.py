"""Pairs of line segments in the plane that come near each other."""

import numpy as np
import shapely

from controller.arrays import FloatArray, IntArray

SAMPLE = 256


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products (n,) of vectors (n, 2) of the plane."""
    product: FloatArray = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def tree_of(a: FloatArray, b: FloatArray) -> shapely.STRtree:
    """Return a search tree over segments from a to b, (n, 2) each."""
    return shapely.STRtree(np.asarray(shapely.linestrings(np.stack([a, b], axis=1))))


def crowding(tree: shapely.STRtree, p: FloatArray, q: FloatArray) -> float:
    """Return the mean number of a tree's segments in the box of one of the given segments.

    A mean over some of them, evenly spread: enough to distinguish dozens from thousands.

    Parameters
    ----------
    tree : tree of other segments in the same plane
    p, q : (n, 2) start and end points of the given ones
    """
    some = np.unique(np.linspace(0, max(len(p) - 1, 0), SAMPLE).astype(np.int64))[: len(p)]
    own, _ = near_pairs(tree, p[some], q[some])
    return len(own) / max(len(some), 1)


def near_pairs(
    tree: shapely.STRtree, p: FloatArray, q: FloatArray, reach: float | FloatArray = 0.0
) -> tuple[IntArray, IntArray]:
    """Return the pairs of segments p to q and of the tree's whose boxes come within ``reach``.

    Boxes only: callers work out the distance they need anyway, and faster than GEOS one by one.

    Parameters
    ----------
    tree : tree of the segments' boxes
    p, q : (n, 2); equal for points
    reach : one or (n,)

    Returns
    -------
    own, other : (m,) number of the segment p to q, and of the tree's
    """
    grown = np.asarray(reach)[..., None]
    boxes = np.stack([np.minimum(p, q) - grown, np.maximum(p, q) + grown], axis=1)
    own, other = tree.query(shapely.linestrings(boxes))
    return own, other
