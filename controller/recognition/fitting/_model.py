"""What of a part shows as an edge, prepared once so that any view of it takes a millisecond."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.cad import RayCaster, Solid, prepare_views

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FLAT = 1e-4  # |n1 - n2| of triangles that lie in one plane: the edge between them never shows


@dataclass(frozen=True, eq=False, slots=True)
class EdgeModel:
    """A part's mesh edges with what lies beside them, CAD frame.

    Attributes
    ----------
    solid : the part
    caster : rays against its mesh
    normals : (t, 3) unit normals of the triangles
    start_mm, along_mm : (e, 3) one end of each mesh edge, and the way to the other
    length_mm : (e,)
    first, second : (e, 4) planes of the two triangles beside it: unit normal, and distance from
        the origin along it
    out : (e, 3) unit direction out of the material, half-way between the two normals
    is_crease : (e,) part of a CAD edge at which two surfaces meet at an angle
    """

    solid: Solid
    caster: RayCaster
    normals: Array
    start_mm: Array
    along_mm: Array
    length_mm: Array
    first: Array
    second: Array
    out: Array
    is_crease: Bools


def edge_model(solid: Solid) -> EdgeModel:
    """Return what `predict_edges` needs of a part."""
    model = prepare_views(solid)
    corners = model.vertices_mm[model.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    planes = np.column_stack([normals, np.einsum("ij,ij->i", normals, corners[:, 0])])
    sides = model.sides
    bent = np.linalg.norm(normals[sides[:, 0]] - normals[sides[:, 1]], axis=1) > FLAT
    ends, sides = model.ends[bent], sides[bent]
    start, end = model.vertices_mm[ends[:, 0]], model.vertices_mm[ends[:, 1]]
    both = normals[sides].sum(axis=1)
    # where two triangles fold back on each other any direction is as good as another
    out = both / np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-6)
    return EdgeModel(
        solid=solid,
        caster=model.caster,
        normals=normals,
        start_mm=start,
        along_mm=end - start,
        length_mm=np.linalg.norm(end - start, axis=1),
        first=planes[sides[:, 0]],
        second=planes[sides[:, 1]],
        out=out,
        is_crease=((model.cad_edge >= 0) & ~model.is_smooth)[bent],
    )
