"""Edges that lie wholly behind one sheet of the surface, found without cutting them.

Seen from the side, the rims of a plate's thousand bores coincide on two lines, and cutting each by
all others takes time and memory by their square. Nearly all of them are wholly behind the front
wall and therefore invisible. The nearest surface over an edge's start is followed towards its end,
triangle by triangle, until the sheet folds over or the edge comes out before it.
"""

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array

from .._model import ViewModel
from .._project import EDGE_ON, FRONT, Projection

# Beside the edge: far above the rays' single precision (1e-5 mm) and far below what is measured.
ASIDE_MM = 2e-3
# A ray that leaves a solid meets a back first. A front at this distance or less is the face it
# started from, over which it rises too slowly for single precision; further on, it is a sign of
# a back that was missed on a seam between two triangles.
GRAZING_MM = 0.05
MAX_STEP_COUNT = 16  # triangles; an edge under more of them is cut and tested like any other


def without_covered(
    model: ViewModel, view: Projection, edges: Int32Array, rims: Int32Array
) -> tuple[Int32Array, Int32Array]:
    """Return edges and rims without those hidden along their whole length.

    An edge goes where the eye sees none of its faces beside it, a rim where all it could hide is
    hidden before it: beside it lie the only sheets that begin or end there.

    Parameters
    ----------
    model, view : the part and how the eye has it
    edges : (n,) mesh edges to be drawn where they are seen
    rims : (m,) mesh edges that may hide others
    """
    is_asked = np.zeros(len(model.ends), dtype=np.bool_)
    is_asked[edges] = is_asked[rims] = True
    both = np.flatnonzero(is_asked).astype(np.int32)
    shows, can_hide = np.zeros_like(is_asked), np.zeros_like(is_asked)
    # the side that faces the eye first: where that shows, nothing is left to ask
    first = (view.facing[model.sides[both, 1]] == FRONT).astype(np.int32)
    for side in (first, 1 - first):
        facing = view.facing[model.sides[both, side]]
        open_question = (facing != EDGE_ON) & ~shows[both]
        open_question &= (facing == FRONT) | ~can_hide[both]
        asked, facing = both[open_question], facing[open_question]
        is_free = ~_is_covered(model, view, asked, side[open_question])
        can_hide[asked[is_free]] = True
        shows[asked[is_free & (facing == FRONT)]] = True
    return edges[shows[edges]], rims[can_hide[rims]]


def aside(model: ViewModel, edges: Int32Array, side: Int32Array | int) -> FloatArray:
    """Return the steps (n, 3) from edges onto one of their triangles, at right angles [mm].

    Parameters
    ----------
    model : the part
    edges : (n,) mesh edges
    side : 0 or 1, one for all or (n,): which of an edge's two triangles
    """
    triangle = model.sides[edges, side]
    start, end = model.vertices_mm[model.ends[edges, 0]], model.vertices_mm[model.ends[edges, 1]]
    along = end - start
    along /= np.sqrt(_dot(along, along))[:, None]
    corners = model.triangles[triangle]
    far = corners.sum(axis=1) - model.ends[edges].sum(axis=1)
    inwards = model.vertices_mm[far] - start
    inwards -= _dot(inwards, along)[:, None] * along
    inwards /= np.maximum(np.sqrt(_dot(inwards, inwards)), 1e-300)[:, None]
    step: FloatArray = np.minimum(ASIDE_MM, model.heights_mm[triangle] / 4)[:, None] * inwards
    return step


def _is_covered(
    model: ViewModel, view: Projection, edges: Int32Array, side: Int32Array
) -> BoolArray:
    """Return a mask (n,) of edges that one sheet hides from end to end on their given side (n,)."""
    is_covered = np.zeros(len(edges), dtype=np.bool_)
    step = aside(model, edges, side)
    start = model.vertices_mm[model.ends[edges, 0]] + step
    p, z_p = _projected(model, view, start)
    triangle = _nearest(model, view, start, z_p)
    # most edges that show have their own triangle there
    row = np.flatnonzero((triangle >= 0) & (triangle != model.sides[edges, side]))
    row = row[view.facing[triangle[row]] != EDGE_ON]
    p, z_p, triangle = p[row], z_p[row], triangle[row]
    q, z_q = _projected(model, view, model.vertices_mm[model.ends[edges[row], 1]] + step[row])
    # the height, or one over the depth, that stands for GRAZING_MM
    margin = GRAZING_MM * z_p * z_p if view.is_central else np.full(len(row), GRAZING_MM)
    edge, row = row, np.arange(len(row))
    at_p, at_q, nearness = _within(model, view, triangle, p, q)
    is_over = (at_p >= 0).all(axis=1) & (_dot(at_p, nearness) > z_p + margin)
    row, triangle, reached = row[is_over], triangle[is_over], np.zeros(is_over.sum())
    at_p, at_q, nearness = at_p[is_over], at_q[is_over], nearness[is_over]
    for _ in range(MAX_STEP_COUNT):
        is_end = (at_q >= 0).all(axis=1)
        ended = row[is_end]
        is_covered[edge[ended]] = _dot(at_q, nearness)[is_end] > z_q[ended] + margin[ended]
        on = ~is_end
        if not on.any():
            break
        row, triangle, reached = row[on], triangle[on], reached[on]
        at_p, at_q, nearness = at_p[on], at_q[on], nearness[on]
        # out over the first corner whose share runs down to nothing, that is, the side opposite
        with np.errstate(divide="ignore", invalid="ignore"):
            leaves = np.where(at_q < 0, at_p / (at_p - at_q), np.inf)
        corner = leaves.argmin(axis=1)
        t = leaves[np.arange(len(row)), corner]
        at_t = at_p + t[:, None] * (at_q - at_p)
        z = z_p[row] + t * (z_q - z_p)[row]
        is_over = (t >= reached - 1e-9) & (t <= 1) & (_dot(at_t, nearness) > z + margin[row])
        after = model.across[triangle, (corner + 1) % 3]
        is_over &= view.facing[after] == view.facing[triangle]
        row, triangle, reached = row[is_over], after[is_over], t[is_over]
        at_p, at_q, nearness = _within(model, view, triangle, p[row], q[row])
    return is_covered


def _projected(
    model: ViewModel, view: Projection, p_cad_mm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3) of the CAD frame in the plane (n, 2), and their nearness (n,)."""
    plane = p_cad_mm @ view.matrix[:, :3].T + view.matrix[:, 3]
    if view.is_central:
        return plane[:, :2] / plane[:, 2:], 1.0 / plane[:, 2]
    return plane[:, :2], (p_cad_mm - model.solid.centroid_mm) @ view.eye


def _nearest(
    model: ViewModel, view: Projection, p_cad_mm: FloatArray, nearness: FloatArray
) -> Int32Array:
    """Return the triangle (n,) visible at points (n, 3), -1 for none."""
    if view.is_central:
        return model.caster.first_hit(view.eye, p_cad_mm - view.eye)[0]
    above = view.nearness.max() + 1.0 - nearness
    origins = p_cad_mm + above[:, None] * view.eye
    return model.caster.first_hit(origins, -view.eye)[0]


def _within(
    model: ViewModel, view: Projection, triangle: Int32Array, p: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return barycentric coordinates (n, 3) of p and q, (n, 2) each, and corners' nearness."""
    corners = model.triangles[triangle]
    x, y = view.points[corners, 0].T, view.points[corners, 1].T  # (3, n)
    double_area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    found = []
    for at in (p, q):
        u, v = x - at[:, 0], y - at[:, 1]
        ahead, after = [1, 2, 0], [2, 0, 1]
        found.append((u[ahead] * v[after] - v[ahead] * u[after]) / double_area)
    return found[0].T, found[1].T, view.nearness[corners]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = np.einsum("ij,ij->i", a, b)
    return product
