"""Lines of a part that show as edges, prepared once so that any view takes a millisecond."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray, Int32Array
from controller.cad import Solid, prepare_views
from controller.imaging import RayCaster

# Curvature of a triangle between smooth edges; a plane beside a fillet has less.
CURVED_PER_MM = 0.02
ROUND_SHARE = 0.3  # share of curvature along the surface from which it is curved in both directions
FLAT = 1e-4  # |n1 - n2| of triangles that lie in one plane: the edge between them never shows


@dataclass(frozen=True, eq=False, slots=True)
class EdgeShape:
    """The data for an `EdgeModel`: small enough to be kept for a thousand parts.

    Attributes
    ----------
    centroid_mm : (3,) centre of mass, CAD frame
    vertices_mm : (v, 3)
    triangles : (t, 3)
    ends : (e, 2) vertices of the mesh edges that may show
    sides : (e, 2) their triangles
    is_crease : (e,) part of a CAD edge at which two surfaces meet at an angle
    """

    centroid_mm: FloatArray
    vertices_mm: FloatArray
    triangles: Int32Array
    ends: Int32Array
    sides: Int32Array
    is_crease: BoolArray


@dataclass(frozen=True, eq=False)
class EdgeModel:
    """A part's mesh edges with the surfaces beside them, CAD frame.

    Attributes
    ----------
    shape : shape it is made from
    centroid_mm : (3,) centre of mass
    caster : rays against the mesh
    normals : (t, 3) unit normals of the triangles
    start_mm, along_mm : (e, 3) one end of each mesh edge, and the way to the other
    length_mm : (e,)
    first, second : (e, 4) planes of the two triangles beside it: unit normal, and distance from
        the origin along it
    out : (e, 3) unit direction out of the material, half-way between the two normals
    is_crease : (e,) part of a CAD edge at which two surfaces meet at an angle
    bend : (e,) |n1 - n2| of the two surfaces of a crease, else 0
    sides : (e, 2) the two triangles beside it
    middle_mm : (e, 3) middle of each mesh edge
    seen_by : (3, e) squared lengths of ``along_mm`` and ``middle_mm``, and their product
    """

    shape: EdgeShape
    centroid_mm: FloatArray
    caster: RayCaster
    normals: FloatArray
    start_mm: FloatArray
    along_mm: FloatArray
    length_mm: FloatArray
    first: FloatArray
    second: FloatArray
    out: FloatArray
    is_crease: BoolArray
    bend: FloatArray
    sides: Int32Array
    middle_mm: FloatArray
    seen_by: FloatArray

    @cached_property
    def straight(self) -> FloatArray:
        """Unit direction (t, 3) in which a triangle's surface is straight while curved across.

        0 where it is curved in both directions, NaN where it is plane. Asked for under lamps alone.
        """
        return _straight(self.shape, self.normals, self.along_mm)


def edge_shape(solid: Solid) -> EdgeShape:
    """Return the lines of a part that may show as edges."""
    model = prepare_views(solid)
    normals = _normals(model.vertices_mm, model.triangles)
    sides = model.sides
    bent = np.linalg.norm(normals[sides[:, 0]] - normals[sides[:, 1]], axis=1) > FLAT
    return EdgeShape(
        centroid_mm=np.asarray(solid.centroid_mm, dtype=np.float64),
        vertices_mm=model.vertices_mm,
        triangles=model.triangles,
        ends=model.ends[bent],
        sides=sides[bent],
        is_crease=((model.cad_edge >= 0) & ~model.is_smooth)[bent],
    )


def edge_model(shape: EdgeShape | Solid) -> EdgeModel:
    """Return the data that `predict_edges` needs of a part."""
    if isinstance(shape, Solid):
        shape = edge_shape(shape)
    vertices, triangles = shape.vertices_mm, shape.triangles
    normals = _normals(vertices, triangles)
    offsets = np.einsum("ij,ij->i", normals, vertices[triangles[:, 0]])
    planes = np.column_stack([normals, offsets])
    start, end = vertices[shape.ends[:, 0]], vertices[shape.ends[:, 1]]
    both = normals[shape.sides].sum(axis=1)
    # where two triangles fold back on each other any direction is as good as another
    out = both / np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-6)
    along = end - start
    middle = start + 0.5 * along
    pairs = (along, along), (middle, middle), (middle, along)
    return EdgeModel(
        shape=shape,
        centroid_mm=shape.centroid_mm,
        caster=RayCaster(trimesh.Trimesh(vertices, triangles, process=False, validate=False)),
        normals=normals,
        start_mm=start,
        along_mm=along,
        length_mm=np.linalg.norm(along, axis=1),
        first=planes[shape.sides[:, 0]],
        second=planes[shape.sides[:, 1]],
        out=out,
        is_crease=shape.is_crease,
        bend=np.linalg.norm(np.diff(normals[shape.sides], axis=1)[:, 0], axis=1) * shape.is_crease,
        sides=shape.sides,
        middle_mm=middle,
        seen_by=np.stack([np.einsum("ij,ij->i", a, b) for a, b in pairs]),
    )


def _straight(shape: EdgeShape, normals: FloatArray, along: FloatArray) -> FloatArray:
    """Return the direction in which triangles are straight, (t, 3): see `EdgeModel`."""
    out = np.full(normals.shape, np.nan)
    smooth = ~shape.is_crease
    sides, along = shape.sides[smooth], along[smooth]
    length = np.linalg.norm(along, axis=1)
    bend = np.linalg.norm(normals[sides[:, 0]] - normals[sides[:, 1]], axis=1) * length
    curvature = np.zeros((len(normals), 3, 3))
    for side in sides.T:
        across = np.cross(normals[side], along / np.maximum(length, 1e-12)[:, None])
        np.add.at(curvature, side, bend[:, None, None] * across[:, :, None] * across[:, None, :])
    corners = shape.vertices_mm[shape.triangles]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(doubled, axis=1)
    curved = np.flatnonzero(np.trace(curvature, axis1=1, axis2=2) > CURVED_PER_MM * area)
    if len(curved) == 0:
        return out
    sizes, directions = np.linalg.eigh(curvature[curved])
    is_round = sizes[:, 1] > ROUND_SHARE * sizes[:, 2]
    out[curved] = np.cross(normals[curved], directions[:, :, 2])
    out[curved[is_round]] = 0.0
    return out


def _normals(vertices_mm: FloatArray, triangles: Int32Array) -> FloatArray:
    corners = vertices_mm[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit: FloatArray = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    return unit
