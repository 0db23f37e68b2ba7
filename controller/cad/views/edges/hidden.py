"""Hidden-line removal: the pieces of the edges that the eye sees.

Along an edge, visibility changes only where a rim of the part passes in front of it (Appel's
observation, 1967). Every edge is cut there, exactly, and one ray per piece decides: it starts
beside the middle of the piece, on the face that the eye has next to it.
"""

from dataclasses import dataclass

import numpy as np
from shapely import STRtree

from controller.arrays import BoolArray, FloatArray, Int32Array, IntArray

from .._model import ViewModel
from .._project import BACK, EDGE_ON, FRONT, Projection
from .._segments import cross, crowding, near_pairs, tree_of
from .covered import GRAZING_MM, aside

ABOVE_MM = 1e-3  # start of a ray over its face: clear of single precision (1e-5 mm)
SHORTEST_MM = 1e-3  # shortest piece; two cuts closer than that are one
PAIRS_AT_ONCE = 500_000  # pairs of edges and rims: some 150 MB
END_ON_RAD = 1e-4  # lines closer to the line of sight than that show as points


@dataclass(frozen=True, eq=False, slots=True)
class EdgeRuns:
    """Runs of mesh edges, none of them partly hidden.

    Attributes
    ----------
    mesh_edge : (n,) edge of the model each is of, in order along it
    start, end : (n,) start and end along that edge, 0 to 1 in the plane
    """

    mesh_edge: Int32Array
    start: FloatArray
    end: FloatArray


def candidate_edges(model: ViewModel, view: Projection) -> Int32Array:
    """Return the mesh edges (n,) that are visible unless something hides them."""
    one, other = view.facing[model.sides[:, 0]], view.facing[model.sides[:, 1]]
    is_drawn = (model.cad_edge >= 0) | ((one == FRONT) != (other == FRONT))
    # neither on the far side of a ridge, nor in a valley under its own overhang
    is_shown = (one == FRONT) | (other == FRONT)
    is_under = ((one == BACK) | (other == BACK)) & ~model.is_ridge
    chosen = np.flatnonzero(is_drawn & is_shown & ~is_under)
    ends = model.ends[chosen]
    shown = np.linalg.norm(view.points[ends[:, 1]] - view.points[ends[:, 0]], axis=1)
    length = np.linalg.norm(model.vertices_mm[ends[:, 1]] - model.vertices_mm[ends[:, 0]], axis=1)
    kept: Int32Array = chosen[shown > END_ON_RAD * length * view.scale].astype(np.int32)
    return kept


def cut_edges(
    view: Projection, model: ViewModel, edges: Int32Array, rims: Int32Array, rim_tree: STRtree
) -> EdgeRuns:
    """Return edges (n,) cut at their crossings with rims in the plane that pass in front.

    Parameters
    ----------
    view, model : direction of view of the part, and the part
    edges : (n,) mesh edges to cut
    rims : (m,) mesh edges that may hide others
    rim_tree : `tree_of_edges` of the rims
    """
    gap = SHORTEST_MM * view.scale
    p, q = view.points[model.ends[edges, 0]], view.points[model.ends[edges, 1]]
    size = int(np.clip(PAIRS_AT_ONCE / max(crowding(rim_tree, p, q), 1), 64, 65536))
    cuts = [
        _crossings(view, model, edges, rims, rim_tree, slice(at, at + size))
        for at in range(0, len(edges), size)
    ]
    cut_edge = np.concatenate([edge for edge, _ in cuts] or [np.zeros(0, dtype=np.int64)])
    cut_at = np.concatenate([at for _, at in cuts] or [np.zeros(0)])
    shown = np.linalg.norm(q - p, axis=1)
    margin = gap / shown[cut_edge]
    keep = (cut_at > margin) & (cut_at < 1 - margin)
    count = np.arange(len(edges))
    owner = np.concatenate([count, count, cut_edge[keep]])
    at = np.concatenate([np.zeros(len(edges)), np.ones(len(edges)), cut_at[keep]])
    order = np.lexsort((at, owner))
    owner, at = owner[order], at[order]
    is_apart = np.ones(len(at), dtype=np.bool_)
    is_apart[1:] = (np.diff(owner) != 0) | (np.diff(at) * shown[owner[1:]] > gap) | (at[1:] == 1)
    owner, at = owner[is_apart], at[is_apart]
    inside = np.flatnonzero(np.diff(owner) == 0)
    return EdgeRuns(edges[owner[inside]], at[inside], at[inside + 1])


def tree_of_edges(model: ViewModel, view: Projection, edges: Int32Array) -> STRtree:
    """Return a search tree over mesh edges (n,) in the plane.

    Parameters
    ----------
    model, view : the part and how the eye has it
    edges : (n,) mesh edges; a result of the tree is an index into these
    """
    return tree_of(view.points[model.ends[edges, 0]], view.points[model.ends[edges, 1]])


def _crossings(
    view: Projection,
    model: ViewModel,
    edges: Int32Array,
    rims: Int32Array,
    rim_tree: STRtree,
    some: slice,
) -> tuple[IntArray, FloatArray]:
    """Return the edges of a slice that are cut (m,), and where each is cut (m,), unordered."""
    gap = SHORTEST_MM * view.scale
    p, q = view.points[model.ends[edges, 0]], view.points[model.ends[edges, 1]]
    a, b = view.points[model.ends[rims, 0]], view.points[model.ends[rims, 1]]
    edge, rim = near_pairs(rim_tree, p[some], q[some])
    edge = edge + some.start
    own, other = model.ends[edges[edge]], model.ends[rims[rim]]
    is_other = (own[:, 0] != other[:, 0]) & (own[:, 1] != other[:, 1])
    is_other &= (own[:, 0] != other[:, 1]) & (own[:, 1] != other[:, 0])
    edge, rim = edge[is_other], rim[is_other]
    r, s, w = (q - p)[edge], (b - a)[rim], a[rim] - p[edge]
    length, rim_length = np.linalg.norm(r, axis=1), np.linalg.norm(s, axis=1)
    turn = cross(r, s)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = cross(w, s) / turn, cross(w, r) / turn
        slack = 1e-3 * gap / rim_length
        is_met = (t > 0) & (t < 1) & (u > -slack) & (u < 1 + slack)
    z, z_rim = view.nearness[model.ends[edges[edge]]], view.nearness[model.ends[rims[rim]]]
    # a rim behind cuts other rims nonetheless: there they leave or join the outline
    both_rims = np.isin(edges, rims)[edge]
    with np.errstate(invalid="ignore"):
        in_front = z_rim[:, 0] + u * (z_rim[:, 1] - z_rim[:, 0]) > z[:, 0] + t * (z[:, 1] - z[:, 0])
    is_met &= in_front | both_rims
    # one on top of the other: whatever changes, changes at the ends of the one in front
    is_flush = (np.abs(turn) < 1e-3 * length * rim_length) & (np.abs(cross(w, r)) < gap * length)
    cuts = [(edge[is_met], t[is_met])]
    for corner in (w, w + s):
        at = (corner[is_flush] * r[is_flush]).sum(axis=1) / length[is_flush] ** 2
        cuts.append((edge[is_flush], at))
    cut_edge = np.concatenate([c[0] for c in cuts])
    cut_at = np.concatenate([c[1] for c in cuts])
    return cut_edge, cut_at


def is_seen(model: ViewModel, view: Projection, pieces: EdgeRuns) -> BoolArray:
    """Return a mask (n,) of the visible pieces: those with one of their faces in sight beside them.

    Parameters
    ----------
    model, view : the part and how the eye has it
    pieces : n runs of mesh edges, each wholly seen or wholly hidden; their middles are asked about
    """
    middle = points_on(model, view, pieces.mesh_edge, (pieces.start + pieces.end) / 2)
    seen = np.zeros(len(middle), dtype=np.bool_)
    for side in (0, 1):
        triangle = model.sides[pieces.mesh_edge, side]
        asked = np.flatnonzero((view.facing[triangle] == FRONT) & ~seen)
        beside = middle[asked] + aside(model, pieces.mesh_edge[asked], side)
        seen[asked] = in_sight(model, view, beside)
    return seen


def in_sight(model: ViewModel, view: Projection, p_cad_mm: FloatArray) -> BoolArray:
    """Return a mask (n,) of the points that the eye sees.

    Parameters
    ----------
    model, view : the part and how the eye has it
    p_cad_mm : (n, 3) CAD frame, on triangles that face the eye
    """
    directions = view.towards_eye(p_cad_mm)
    gone = np.full(len(p_cad_mm), ABOVE_MM)
    free = np.zeros(len(p_cad_mm), dtype=np.bool_)
    open_rays = np.arange(len(p_cad_mm))
    for _ in range(4):
        if len(open_rays) == 0:
            break
        origins = p_cad_mm[open_rays] + gone[open_rays, None] * directions[open_rays]
        triangle, distance = model.caster.first_hit(origins, directions[open_rays])
        free[open_rays] = triangle < 0
        facing = np.where(triangle >= 0, view.facing[triangle], BACK)
        again = (facing != BACK) & (gone[open_rays] + distance < GRAZING_MM)
        again |= facing == EDGE_ON  # a wall along the ray hides nothing
        open_rays, distance = open_rays[again], distance[again]
        gone[open_rays] += distance + ABOVE_MM
    return free


def points_on(
    model: ViewModel, view: Projection, mesh_edge: Int32Array, at: FloatArray
) -> FloatArray:
    """Return points (n, 3) of mesh edges [mm, CAD frame].

    Parameters
    ----------
    model, view : the part and how the eye has it
    mesh_edge : (n,)
    at : (n,) 0 to 1 along each edge as measured in the plane, not in space
    """
    ends = model.ends[mesh_edge]
    if view.is_central:  # 1 / depth is what runs evenly in the plane
        z = view.nearness[ends]
        at = at * z[:, 1] / (z[:, 0] + at * (z[:, 1] - z[:, 0]))
    start, end = model.vertices_mm[ends[:, 0]], model.vertices_mm[ends[:, 1]]
    points: FloatArray = start + at[:, None] * (end - start)
    return points


def plane_at(
    model: ViewModel, view: Projection, mesh_edge: Int32Array, at: FloatArray
) -> FloatArray:
    """Return points (n, 2) of mesh edges in the plane.

    Parameters
    ----------
    model, view : the part and how the eye has it
    mesh_edge : (n,)
    at : (n,) 0 to 1 along each edge in the plane
    """
    ends = model.ends[mesh_edge]
    p = view.points[ends[:, 0]]
    points: FloatArray = p + at[:, None] * (view.points[ends[:, 1]] - p)
    return points


def plane_ends(
    model: ViewModel, view: Projection, pieces: EdgeRuns
) -> tuple[FloatArray, FloatArray]:
    """Return start and end points of pieces in the plane, (n, 2) each.

    Parameters
    ----------
    model, view : the part and how the eye has it
    pieces : n runs of mesh edges
    """
    return (
        plane_at(model, view, pieces.mesh_edge, pieces.start),
        plane_at(model, view, pieces.mesh_edge, pieces.end),
    )
