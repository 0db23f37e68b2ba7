"""The occluding boundary: the union of faces towards the eye, its loops tied to the CAD edges.

The border of the triangles that face the eye winds round every point of the plane once for each
of them that covers it (a closed surface shows the eye as many fronts as backs). What it winds
round at least once is therefore the silhouette, for any shape, and the union needs that border
alone and not the triangles. Walls seen edge-on count as facing the eye: they cover nothing, and
with them a boss and the plate it stands on are one sheet with no seam where the boss begins.
"""

from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, FillRule
from scipy.spatial import cKDTree
from shapely import STRtree

from controller.arrays import BoolArray, FloatArray, Int32Array

from .._model import ViewModel
from .._project import BACK, EDGE_ON_MM, Projection
from .._segments import cross, near_pairs

ROUNDED_MM = 0.15  # distance between the chords of one curve, tessellated twice
ROUNDED_SINE = 0.5
PARALLEL = 0.05  # sine between a side and the edge it lies on, of sides long enough to tell


@dataclass(frozen=True, eq=False, slots=True)
class PlaneLoop:
    """A loop of the outline in the plane; fields as in `Loop`, lens distortion left out."""

    points: FloatArray
    edges: Int32Array
    faces: Int32Array
    is_phantom: BoolArray
    is_hole: bool


def rim_edges(model: ViewModel, view: Projection) -> Int32Array:
    """Return the mesh edges (n,) where the surface turns away from the eye or edge-on to it."""
    is_rim = view.facing[model.sides[:, 0]] != view.facing[model.sides[:, 1]]
    return np.flatnonzero(is_rim).astype(np.int32)


def find_rings(
    model: ViewModel, view: Projection, rims: Int32Array, open_rims: Int32Array, rim_tree: STRtree
) -> list[PlaneLoop]:
    """Return the loops of the outline, outer ones first, the largest one before all.

    Parameters
    ----------
    model, view : the part and how the eye has it
    rims : (n,) `rim_edges`
    open_rims : (m,) the open ones that may be visible, to name the outline by
    rim_tree : search tree over these in the plane
    """
    weld = EDGE_ON_MM * view.scale
    polygons = CrossSection(_borders(model, view, rims), FillRule.Positive).to_polygons()
    found = []
    for polygon in polygons:
        points = _welded(np.asarray(polygon, dtype=np.float64), weld)
        if len(points) < 3:
            continue
        ahead = np.roll(points, -1, axis=0)
        area = 0.5 * float((points[:, 0] * ahead[:, 1] - points[:, 1] * ahead[:, 0]).sum())
        # two sheets that meet edge-on may leave a crack between them, as wide as their noise
        if abs(area) > weld * float(np.linalg.norm(ahead - points, axis=1).sum()):
            found.append((area, points))
    found.sort(key=lambda item: (item[0] < 0, -abs(item[0])))
    if not found:
        return []
    counts = [len(points) for _, points in found]
    points = np.concatenate([points for _, points in found])
    ahead = np.concatenate([np.roll(points, -1, axis=0) for _, points in found])
    corner_tree = cKDTree(view.points[np.unique(model.ends[rims])])
    distance, _ = corner_tree.query(points, distance_upper_bound=2 * weld)
    is_phantom = ~np.isfinite(distance)
    edges, faces = _labels(model, view, open_rims, rim_tree, points, ahead, weld)
    rings = []
    for (area, own), stop in zip(found, np.cumsum(counts), strict=True):
        span = slice(int(stop) - len(own), int(stop))
        rings.append(PlaneLoop(own, edges[span], faces[span], is_phantom[span], area < 0))
    return rings


def _borders(model: ViewModel, view: Projection, rims: Int32Array) -> list[FloatArray]:
    is_away = view.facing[model.sides[rims]] == BACK
    rims, is_away = rims[is_away.any(axis=1)], is_away[is_away.any(axis=1)]
    ends = np.where(is_away[:, :1], model.ends[rims][:, ::-1], model.ends[rims])
    # as many sides enter a vertex as leave it, and which goes on with which changes no winding
    leaving = np.argsort(ends[:, 0], kind="stable")
    entering = np.argsort(ends[:, 1], kind="stable")
    successor = np.empty(len(ends), dtype=np.int64)
    successor[entering] = leaving
    ahead = successor.tolist()
    is_used = [False] * len(ahead)
    borders = []
    for first in range(len(ahead)):
        if is_used[first]:
            continue
        run, here = [], first
        while not is_used[here]:
            is_used[here] = True
            run.append(here)
            here = ahead[here]
        if len(run) > 2:
            borders.append(view.points[ends[run, 0]])
    return borders


def _welded(points: FloatArray, weld: float) -> FloatArray:
    gap = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    welded: FloatArray = points[gap > weld]
    return welded


def _labels(
    model: ViewModel,
    view: Projection,
    rims: Int32Array,
    rim_tree: STRtree,
    start: FloatArray,
    end: FloatArray,
    weld: float,
) -> tuple[Int32Array, Int32Array]:
    """Return CAD edge and curved face of each side, from the nearest rim edge it lies on."""
    edges = np.full(len(start), -1, dtype=np.int32)
    faces = np.full(len(start), -1, dtype=np.int32)
    rim_ends = model.ends[rims]
    p, q = view.points[rim_ends[:, 0]], view.points[rim_ends[:, 1]]
    middle = (start + end) / 2
    wall = view.wall[rims]
    reach = ROUNDED_MM * view.scale if (wall >= 0).any() else 2 * weld
    side, rim = near_pairs(rim_tree, middle, middle, reach)
    along, rim_along = (end - start)[side], (q - p)[rim]
    length2 = np.maximum((rim_along**2).sum(axis=1), 1e-300)
    sine = np.abs(cross(along, rim_along)) / np.sqrt(
        np.maximum((along**2).sum(axis=1), 1e-300) * length2
    )
    is_short = (along**2).sum(axis=1) < (100 * weld) ** 2
    part = np.clip(((middle[side] - p[rim]) * rim_along).sum(axis=1) / length2, 0, 1)
    apart = np.linalg.norm(p[rim] + part[:, None] * rim_along - middle[side], axis=1)
    is_on = (apart < 2 * weld) & ((sine < PARALLEL) | is_short)
    # the other rim of the bore that the side is a rim of, however it is tessellated
    own_wall = np.full(len(start), -1, dtype=np.int32)
    own_wall[side[is_on]] = wall[rim[is_on]]
    is_on |= (wall[rim] >= 0) & (wall[rim] == own_wall[side]) & (sine < ROUNDED_SINE)
    side, rim, part = side[is_on], rim[is_on], part[is_on]
    z = view.nearness[rim_ends[rim]]
    nearness = z[:, 0] + part * (z[:, 1] - z[:, 0])
    # last of its side: the nearest to the eye, and a CAD edge before a bare mesh edge
    order = np.lexsort((model.cad_edge[rims[rim]] >= 0, nearness, side))
    side, rim = side[order], rims[rim[order]]
    last = np.flatnonzero(np.diff(side, append=-1) != 0)
    side, rim = side[last], rim[last]
    edges[side] = model.cad_edge[rim]
    face = model.solid.face_of_triangle[model.sides[rim, 0]]
    faces[side] = np.where(model.cad_edge[rim] >= 0, -1, face)
    return edges, faces
