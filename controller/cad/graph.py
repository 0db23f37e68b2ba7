"""Which things hang together: triangles over their sides, facets over smooth edges."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from controller.arrays import IntArray


def components(count: int, a: NDArray[np.integer], b: NDArray[np.integer]) -> IntArray:
    """Return for each of ``count`` nodes the number of its connected component (count,).

    Parameters
    ----------
    count : of the nodes, numbered from 0
    a, b : (n,) nodes that are linked, pair by pair
    """
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
