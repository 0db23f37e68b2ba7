"""Toppling of a dropped part without a bounce: quasi-static probabilities, and the passes.

Goldberg and others, "Part pose statistics" (references.md L1): a part lands on
a hull facet as often as that facet fills the sphere round the centre of mass, and topples on from
facet to facet until the centre stands over one. The height of the centre above the table, as a
function of the direction that points down, is a landscape; a facet the part rests on is a hollow of
it and an edge between two facets is a pass. What it takes to leave a hollow is the climb to its
lowest pass, which is the paper's energy to tip over the easiest edge.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from ._hull import SHORT, Hull


@dataclass(frozen=True, eq=False, slots=True)
class Landscape:
    """Heights of the centre of mass over all directions down, for the search of rests.

    Attributes
    ----------
    rest : (f,) facet on which a part ends that lands on this one
    probabilities : (f,) quasi-static, of ending on a facet; 0 where it does not stay
    shares : (f,) shares of the sphere, of landing on a facet
    pass_mm : (e,) height of the centre on the way over each hull edge
    """

    rest: IntArray
    probabilities: FloatArray
    shares: FloatArray
    pass_mm: FloatArray


def landscape_of(hull: Hull) -> Landscape:
    """Return rest facets, probabilities and pass heights of a part that topples over its hull."""
    to_edge = _distances_mm(hull)
    stays = _stays(hull, to_edge)
    share = _shares(hull)
    ends_on = hull.facet[_settle(hull, stays)]
    probabilities = np.bincount(ends_on, share, minlength=hull.count)
    total = float(
        probabilities.sum()
    )  # 1 but for rounding; a half with the centre on the hull itself
    shares = np.bincount(hull.facet, share, minlength=hull.count) / total
    rest = np.empty(hull.count, dtype=np.int64)
    largest = np.argsort(share, kind="stable")  # the largest triangle of a facet speaks for it
    rest[hull.facet[largest]] = ends_on[largest]
    return Landscape(rest, probabilities / total, shares, _passes(hull, to_edge))


def _distances_mm(hull: Hull) -> FloatArray:
    """Return the depth (e, 2) of the centre inside its two facets' edge, negative outside [mm]."""
    start, end = hull.corners_mm[hull.edge_ends[:, 0]], hull.corners_mm[hull.edge_ends[:, 1]]
    along = end - start
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    sides = []
    for side, sense in ((0, 1.0), (1, -1.0)):
        inward = sense * np.cross(hull.normals[hull.edge_facets[:, side]], along)
        sides.append(-np.einsum("ij,ij->i", inward, start))
    return np.column_stack(sides)


def _stays(hull: Hull, to_edge: FloatArray) -> BoolArray:
    """Return a mask (f,) of the facets on which the part stays: the centre is in their outline."""
    ends = hull.corners_mm[hull.edge_ends]
    long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > SHORT * hull.blur_mm
    inside = np.full(hull.count, np.inf)
    for side in (0, 1):
        np.minimum.at(inside, hull.edge_facets[long, side], to_edge[long, side])
    # a facet without one long side is a speck of noise
    return np.asarray((inside > 0) & np.isfinite(inside))


def _shares(hull: Hull) -> FloatArray:
    """Return each triangle's share of the sphere round the centre (t,).

    van Oosterom and Strackee, equation 8 (references.md L2).
    """
    a, b, c = (hull.corners_mm[hull.triangles[:, i]] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.maximum(np.einsum("ij,ij->i", a, np.cross(b, c)), 0.0)
    ab, bc, ca = (np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a)))
    return np.asarray(
        2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb) / (4 * np.pi)
    )


def _settle(hull: Hull, stays: BoolArray) -> IntArray:
    """Return the final resting triangle (t,) of a part that lands on each triangle.

    A triangle topples over the side that the line from its middle to the point under the centre
    crosses. Each step lowers the centre; among triangles of one plane, or nearly so, rounding can
    lead in a circle, and there the path goes straight down to the lowest facet beside.
    """
    step = np.where(stays[hull.facet], np.arange(len(hull.facet)), _over(hull))
    last = _follow(step)
    lost = ~stays[hull.facet[last]]
    if lost.any():
        lowest, beside = _lowest_beside(hull)
        facet = hull.facet
        sinks = lowest[facet] >= hull.heights_mm[facet]
        step = np.where(lost, np.where(sinks, np.arange(len(facet)), beside[facet]), step)
        last = _follow(step)
        # all of a facet that holds a part ends on one triangle's facet, so that no
        # probability is split
    return last


def _over(hull: Hull) -> IntArray:
    """Return the triangle (t,) to which each triangle topples."""
    corners = hull.corners_mm[hull.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = np.where(
        (length > hull.blur_mm**2)[:, None],
        normals / np.maximum(length, 1e-300)[:, None],
        hull.normals[hull.facet],
    )
    middle = corners.mean(axis=1)
    heights = np.einsum("ij,ij->i", normals, middle)
    aim = heights[:, None] * normals - middle
    margin = np.empty((len(corners), 3))
    for k in range(3):  # the side opposite to corner k
        first, second = corners[:, (k + 1) % 3] - middle, corners[:, (k + 2) % 3] - middle
        left = np.einsum("ij,ij->i", np.cross(first, aim), normals)
        right = np.einsum("ij,ij->i", np.cross(aim, second), normals)
        margin[:, k] = np.minimum(left, right)
    side = np.argmax(margin, axis=1)
    return np.asarray(hull.neighbours[np.arange(len(corners)), side])


def _follow(step: IntArray) -> IntArray:
    """Return the last facet of each chain of steps (t,); for a circle, a facet within it."""
    for _ in range(max(1, int(np.ceil(np.log2(len(step)))) + 1)):
        further = step[step]
        if np.array_equal(further, step):
            break
        step = further
    return step


def _lowest_beside(hull: Hull) -> tuple[FloatArray, IntArray]:
    """Return the least height of a facet beside each facet (f,), and a triangle of it (f,)."""
    here = np.concatenate([hull.edge_facets[:, 0], hull.edge_facets[:, 1]])
    there = np.concatenate([hull.edge_facets[:, 1], hull.edge_facets[:, 0]])
    lowest = np.full(hull.count, np.inf)
    order = np.lexsort((-hull.heights_mm[there], here))  # the lowest of each facet is written last
    lowest[here[order]] = hull.heights_mm[there[order]]
    beside = np.zeros(hull.count, dtype=np.int64)
    _, triangle = np.unique(hull.facet, return_index=True)
    beside[here[order]] = triangle[there[order]]
    return lowest, beside


def _passes(hull: Hull, to_edge: FloatArray) -> FloatArray:
    """Return the greatest height of the centre on its path over each edge (e,)."""
    heights = hull.heights_mm[hull.edge_facets]
    start, end = hull.corners_mm[hull.edge_ends[:, 0]], hull.corners_mm[hull.edge_ends[:, 1]]
    along = end - start
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    arm = start - np.einsum("ij,ij->i", start, along)[:, None] * along
    # only where the centre comes to stand straight above the edge does it rise on the way
    over = (to_edge > 0).all(axis=1)
    top = heights.max(axis=1)
    top[over] = np.maximum(np.linalg.norm(arm[over], axis=1), top[over])
    return np.asarray(top)
