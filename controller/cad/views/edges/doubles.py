"""Removal of doubled lines: a line right under a nearer one is not drawn (references.md P2.2)."""

import numpy as np

from controller.arrays import FloatArray, Int32Array, IntArray

from .._model import ViewModel
from .._project import Projection
from .._segments import cross, tree_of
from ..outlines.outline import ROUNDED_MM, ROUNDED_SINE
from .hidden import SHORTEST_MM, EdgeRuns, plane_ends

DOUBLED_MM = 0.01  # lines closer than this all along show as one
DOUBLED_RAD = 0.05
STRAY_MM = 0.05  # distance of a free wall's silhouette from its rim: a drawing may be off by this


def without_doubles(model: ViewModel, view: Projection, pieces: EdgeRuns) -> EdgeRuns:
    """Return the pieces without those under a nearer one, as the foot of a wall seen edge-on.

    Parameters
    ----------
    model, view : the part and how the eye has it
    pieces : those in sight
    """
    p, q = plane_ends(model, view, pieces)
    if len(p) == 0:
        return pieces
    # two rims of one bore, tessellated differently, keep the distance of their chords
    wall = view.wall[pieces.mesh_edge]
    # and where a free wall is all but edge-on, its facets' silhouette strays about beside its rim
    face = model.solid.face_of_triangle[model.sides[pieces.mesh_edge]]
    is_bare = model.cad_edge[pieces.mesh_edge] < 0
    is_free = np.array([f.kind in ("freeform", "torus") for f in model.solid.faces])
    is_bent = is_bare & is_free[face[:, 0]]
    reach = np.where(is_bent, STRAY_MM, DOUBLED_MM)
    reach = np.where(wall >= 0, ROUNDED_MM, reach) * view.scale
    # one set of boxes for both, each grown by half of what may lie between two
    half = float(reach.max()) / 2
    tree = tree_of(np.minimum(p, q) - half, np.maximum(p, q) + half)
    under, over = tree.query(tree.geometries)
    differs = pieces.mesh_edge[under] != pieces.mesh_edge[over]
    under, over = under[differs], over[differs]
    run = q - p
    lengths = np.linalg.norm(run, axis=1)
    r, s, length, over_length = run[under], run[over], lengths[under], lengths[over]
    is_stray = is_bent[under] & ~is_bare[over] & (face[over] == face[under, :1]).any(axis=1)
    is_rim = (wall[under] >= 0) & (wall[under] == wall[over]) | is_stray
    limit = np.where(is_rim, ROUNDED_SINE, DOUBLED_RAD)
    is_along = np.abs(cross(r, s)) < limit * length * over_length
    under, over, r, length = under[is_along], over[is_along], r[is_along], length[is_along]
    is_stray = is_stray[is_along]
    tolerance = np.where(is_rim[is_along], ROUNDED_MM, DOUBLED_MM)
    tolerance = np.where(is_stray, STRAY_MM, tolerance) * view.scale
    # what is over it from a to b of its length, and how far beside
    to_start, to_end = p[over] - p[under], q[over] - p[under]
    at = np.stack([(to_start * r).sum(axis=1), (to_end * r).sum(axis=1)]) / length**2
    aside = np.stack([cross(r, to_start), cross(r, to_end)]) / length
    a, b = np.clip(at.min(axis=0), 0, 1), np.clip(at.max(axis=0), 0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (aside[1] - aside[0]) / (at[1] - at[0])
        beside = [np.abs(aside[0] + slope * (x - at[0])) for x in (a, b)]
        part = ((a + b) / 2 - at[0]) / (at[1] - at[0])
    nearness = _nearness(model, view, pieces, under, (a + b) / 2)
    over_nearness = _nearness(model, view, pieces, over, part)
    gap = SHORTEST_MM * view.scale
    covers = ((b - a) * length > gap) & (np.maximum(*beside) < tolerance)
    covers &= (over_nearness > nearness) | is_stray
    under, a, b, length = under[covers], a[covers], b[covers], length[covers]
    return _uncovered(pieces, under, a, b, gap / length)


def _uncovered(
    pieces: EdgeRuns, under: Int32Array | IntArray, a: FloatArray, b: FloatArray, short: FloatArray
) -> EdgeRuns:
    """Return pieces without the stretches a to b, in shares of their length, of pieces ``under``.

    All (m,); rests shorter than ``short``, as a share of the piece, are dropped.
    """
    is_left = np.ones(len(pieces.mesh_edge), dtype=np.bool_)
    is_left[under[(a <= short) & (b >= 1 - short)]] = False  # most lie under one line all along
    partly = is_left[under]
    under, a, b, short = under[partly], a[partly], b[partly], short[partly]
    rests: list[tuple[int, float, float]] = []
    order = np.lexsort((a, under))
    bounds = np.flatnonzero(np.diff(under[order], prepend=-1, append=-1))
    for rows in np.split(order, bounds[1:-1]) if len(order) else ():
        piece = int(under[rows[0]])
        is_left[piece] = False
        begin = float(pieces.start[piece])
        width = float(pieces.end[piece]) - begin
        least, reach = float(short[rows[0]]), 0.0
        for low, high in (*zip(a[rows].tolist(), b[rows].tolist(), strict=True), (1.0, 1.0)):
            if low - reach > least:
                rests.append((piece, begin + reach * width, begin + low * width))
            reach = max(reach, high)
    kept = np.flatnonzero(is_left)
    owner = np.concatenate([kept, np.array([r[0] for r in rests], dtype=np.int64)])
    start = np.concatenate([pieces.start[kept], [r[1] for r in rests]])
    end = np.concatenate([pieces.end[kept], [r[2] for r in rests]])
    order = np.lexsort((start, pieces.mesh_edge[owner]))
    return EdgeRuns(pieces.mesh_edge[owner[order]], start[order], end[order])


def _nearness(
    model: ViewModel,
    view: Projection,
    pieces: EdgeRuns,
    piece: Int32Array | IntArray,
    part: FloatArray,
) -> FloatArray:
    at = pieces.start[piece] + part * (pieces.end - pieces.start)[piece]
    z = view.nearness[model.ends[pieces.mesh_edge[piece]]]
    nearness: FloatArray = z[:, 0] + at * (z[:, 1] - z[:, 0])
    return nearness
