"""Connected components (triangles over their sides, facets over smooth edges), and groups."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from controller.arrays import IntArray


def components(count: int, a: NDArray[np.integer], b: NDArray[np.integer]) -> IntArray:
    """Return the number of the connected component of each of ``count`` nodes (count,).

    Parameters
    ----------
    count : number of the nodes, numbered from 0
    a, b : (n,) nodes that are linked, pair by pair
    """
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def grouped(labels: NDArray[np.integer], count: int) -> tuple[IntArray, IntArray]:
    """Return items by their labels (n,), and where each label's begin (count + 1,).

    Those with label i are ``items[start[i]:start[i + 1]]``, in rising order.

    Parameters
    ----------
    labels : (n,) label of each item, from 0 to below ``count``
    count : number of labels
    """
    items = np.argsort(labels, kind="stable")
    return items, np.searchsorted(labels[items], np.arange(count + 1))


def distinct(values: NDArray[np.integer]) -> IntArray:
    """Return the values of an array of integers, each once, in rising order (k,).

    `np.unique` answers the same from a hash table, which for millions of numbers takes several
    times as long as sorting them, and more memory.
    """
    ordered = np.sort(values, axis=None)
    first = np.ones(len(ordered), dtype=bool)
    first[1:] = ordered[1:] != ordered[:-1]
    return np.asarray(ordered[first], dtype=np.int64)
