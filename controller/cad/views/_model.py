"""Data for line drawings of a solid in any direction.

Worked out once per part: which two triangles meet along each mesh edge, which CAD edge the mesh
edge is part of, whether it is a ridge or a valley, and the rays' search tree.
"""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, Int32Array
from controller.imaging import RayCaster

from ..boundary import Crease
from ..large import spans
from ..solid import Solid


@dataclass(frozen=True, eq=False, slots=True)
class ViewModel:
    """A solid, ready to be drawn from any side; see `prepare_views`.

    Attributes
    ----------
    solid : the part
    caster : rays against its mesh
    vertices_mm : (v, 3) vertices of the mesh, CAD frame
    triangles : (t, 3) their corners
    heights_mm, longest_mm : (t,) smallest height of each triangle, and its longest side
    ends : (e, 2) vertices of each mesh edge
    sides : (e, 2) its triangles; round the first one it runs from ``ends[:, 0]`` to
        ``ends[:, 1]``, round the second one back
    across : (t, 3) triangle next to each one over the side from its corner i to the next
    is_ridge : (e,) the solid is convex there
    cad_edge : (e,) CAD edge it is part of, -1 inside a face
    is_smooth : (e,) part of a CAD edge where two faces run into each other without a crease
    is_corner : (v,) a vertex of the boundary, where drawn edges end
    """

    solid: Solid
    caster: RayCaster
    vertices_mm: FloatArray
    triangles: Int32Array
    heights_mm: FloatArray
    longest_mm: FloatArray
    ends: Int32Array
    sides: Int32Array
    across: Int32Array
    is_ridge: BoolArray
    cad_edge: Int32Array
    is_smooth: BoolArray
    is_corner: BoolArray


def prepare_views(solid: Solid) -> ViewModel:
    """Return the data that all views of a solid share."""
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    triangles = np.asarray(solid.mesh.faces, dtype=np.int32)
    ends, sides, across = _mesh_edges(triangles, len(vertices))
    cross, longest = np.empty((len(triangles), 3)), np.empty(len(triangles))
    for some in spans(len(triangles)):
        corners = vertices[triangles[some]]
        sides_mm = corners[:, [1, 2, 0]] - corners
        cross[some] = np.cross(sides_mm[:, 0], -sides_mm[:, 2])
        longest[some] = np.linalg.norm(sides_mm, axis=2).max(axis=1)
    heights = np.linalg.norm(cross, axis=1) / np.maximum(longest, 1e-300)
    # the corner of the second triangle that is not on the edge: below the first one on a ridge
    far = triangles[sides[:, 1]].sum(axis=1) - ends.sum(axis=1)
    above = ((vertices[far] - vertices[ends[:, 0]]) * cross[sides[:, 0]]).sum(axis=1)
    cad_edge, is_smooth = _cad_edges(solid, ends, len(vertices))
    is_corner = np.zeros(len(vertices), dtype=np.bool_)
    is_corner[solid.boundary.vertex_ids] = True
    return ViewModel(
        solid=solid,
        caster=RayCaster(solid.mesh),
        vertices_mm=vertices,
        triangles=triangles,
        heights_mm=heights,
        longest_mm=longest,
        ends=ends,
        sides=sides,
        across=across,
        is_ridge=above < 0,
        cad_edge=cad_edge,
        is_smooth=is_smooth,
        is_corner=is_corner,
    )


def _mesh_edges(
    triangles: Int32Array, vertex_count: int
) -> tuple[Int32Array, Int32Array, Int32Array]:
    start = triangles.ravel().astype(np.int64)
    end = triangles[:, [1, 2, 0]].ravel().astype(np.int64)
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    # closed and consistently wound (make_solid): each key twice, once in each direction
    first, second = order[0::2], order[1::2]
    ends = np.column_stack([start[first], end[first]]).astype(np.int32)
    sides = np.column_stack([first // 3, second // 3]).astype(np.int32)
    across = np.empty(len(key), dtype=np.int32)
    across[first], across[second] = second // 3, first // 3
    return ends, sides, across.reshape(-1, 3)


def _cad_edges(solid: Solid, ends: Int32Array, vertex_count: int) -> tuple[Int32Array, BoolArray]:
    boundary = solid.boundary
    chain = boundary.chain.astype(np.int64)
    edge = np.repeat(np.arange(boundary.edge_count), np.diff(boundary.chain_start))
    inside = edge[:-1] == edge[1:]
    start, end = chain[:-1][inside], chain[1:][inside]
    edge = edge[:-1][inside]
    low, high = np.minimum(start, end), np.maximum(start, end)
    drawn_key = low * vertex_count + high
    order = np.argsort(drawn_key)
    drawn_key, edge = drawn_key[order], edge[order]
    ends = ends.astype(np.int64)
    key = ends.min(axis=1) * vertex_count + ends.max(axis=1)
    at = np.minimum(np.searchsorted(drawn_key, key), max(len(drawn_key) - 1, 0))
    found = np.full(len(key), -1, dtype=np.int32)
    if len(drawn_key):
        is_drawn = drawn_key[at] == key
        found[is_drawn] = edge[at[is_drawn]]
    is_smooth = (found >= 0) & (boundary.crease[found] == Crease.SMOOTH if len(edge) else False)
    return found, np.asarray(is_smooth, dtype=np.bool_)
