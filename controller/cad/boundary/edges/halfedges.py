"""Half-edges of a triangle mesh, and those between two surfaces.

Half-edge ``3 t + k`` runs from corner k of triangle t to its next corner, the triangle to its
left. All steps are array steps: long runs (round a vertex, along an edge) are done by pointer
doubling, so that a fan of many thousand triangles costs no more than a short one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, IntArray

from ...graph import components


def first_of_each(labels: NDArray[np.integer], count: int) -> IntArray:
    """Return the first index that bears each label 0 .. count - 1 (count,)."""
    first = np.full(count, len(labels), dtype=np.int64)
    np.minimum.at(first, labels, np.arange(len(labels)))
    return first


@dataclass(frozen=True, eq=False, slots=True)
class HalfEdges:
    """Half-edges of a closed triangle mesh with h = 3 x triangles.

    Attributes
    ----------
    origin : (h,) mesh vertex each leaves
    twin : (h,) the one on the other side
    fan : (h,) number of the ring of triangles round its origin; two rings that touch in one mesh
        vertex (where a solid touches itself) count as two
    fan_count : number of rings
    """

    origin: IntArray
    twin: IntArray
    fan: IntArray
    fan_count: int


def half_edges(triangles: NDArray[np.integer]) -> HalfEdges:
    """Return the half-edges of triangles (n, 3) of a closed, consistently wound surface.

    Raises
    ------
    ValueError : an edge without exactly two sides that run opposite ways
    """
    origin = np.asarray(triangles, dtype=np.int64).ravel()
    here = np.arange(len(origin))
    after = next_in_triangle(here)
    target = origin[after]
    size = int(origin.max(initial=0)) + 1
    low, high = np.minimum(origin, target), np.maximum(origin, target)
    order = np.argsort(low * size + high, kind="stable")
    if len(order) % 2:
        raise ValueError("the surface is not closed")
    one, other = order[0::2], order[1::2]
    if not (
        np.array_equal(origin[one], target[other]) and np.array_equal(target[one], origin[other])
    ):
        raise ValueError("the surface is not closed, or not wound consistently")
    twin = np.empty_like(here)
    twin[one], twin[other] = other, one
    fan = components(len(here), here, after[twin])
    return HalfEdges(origin, twin, fan, int(fan.max(initial=-1)) + 1)


def next_in_triangle(half_edge: IntArray) -> IntArray:
    """Return the following half-edge of the same triangle."""
    return np.where(half_edge % 3 == 2, half_edge - 2, half_edge + 1)


def next_on_rim(mesh: HalfEdges, is_rim: BoolArray) -> IntArray:
    """Return the next half-edge on the same rim for each on a rim (h,); -1 off the rim."""
    here = np.arange(len(is_rim))
    # turning about the far end, inside the surface, until its rim is met again
    turn = np.where(is_rim, here, next_in_triangle(mesh.twin))
    if is_rim.any():
        has_rim = np.zeros(mesh.fan_count, dtype=bool)
        has_rim[mesh.fan[is_rim]] = True
        walk = np.nonzero(has_rim[mesh.fan] & ~is_rim)[0]
        while len(walk):
            turn[walk] = turn[turn[walk]]
            walk = walk[~is_rim[turn[walk]]]
    return np.where(is_rim, turn[next_in_triangle(here)], -1)


def rank_chains(successor: IntArray) -> tuple[IntArray, IntArray]:
    """Return the last element of each element's chain and the steps to it.

    Parameters
    ----------
    successor : (n,) next element, -1 at an end; no cycles
    """
    here = np.arange(len(successor))
    jump = np.where(successor < 0, here, successor)
    steps = (successor >= 0).astype(np.int64)
    while True:
        further = jump[jump]
        if np.array_equal(further, jump):
            return jump, steps
        steps = steps + steps[jump]
        jump = further
