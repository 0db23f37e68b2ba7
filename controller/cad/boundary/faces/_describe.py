"""The list of `Face`, from triangles with an owner."""

import numpy as np
import trimesh

from controller.arrays import FloatArray, Int32Array, IntArray

from ...graph import grouped
from ...large import sums_by
from .._types import NO_DIRECTION, Face, turn_of
from ..formulas.primitives import Primitive

CANCELS = 1e-3  # share of a face's area; a shorter mean normal has no direction


def describe(
    mesh: trimesh.Trimesh, owner: IntArray, primitives: list[Primitive | None]
) -> tuple[tuple[Face, ...], Int32Array]:
    """Return the faces, largest first, and the face of each triangle (n,).

    Parameters
    ----------
    mesh : CAD frame [mm], n triangles
    owner : (n,) number of each triangle's surface in ``primitives``; None has no formula
    primitives : the surfaces fitted
    """
    numbers, of = np.unique(owner, return_inverse=True)
    areas = np.asarray(mesh.area_faces)
    weights = np.maximum(areas, 1e-12)
    raw = of.ravel()
    total = np.bincount(raw, weights=areas)
    order = np.argsort(-total, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    face = rank[raw]
    normals = np.asarray(mesh.face_normals)
    middles = np.asarray(mesh.triangles_center)
    share = np.bincount(face, weights=weights)
    mean = sums_by(face, normals * areas[:, None])
    centre = sums_by(face, middles * weights[:, None]) / share[:, None]
    formula = [primitives[numbers[i]] for i in order]
    outward = _outward(formula, face, middles, normals, areas)
    faces = tuple(
        _face(i, formula[i], float(total[order[i]]), mean[i], centre[i], float(outward[i]))
        for i in range(len(order))
    )
    return faces, face.astype(np.int32)


def _outward(
    formula: list[Primitive | None],
    face: IntArray,
    middles: FloatArray,
    normals: FloatArray,
    areas: FloatArray,
) -> FloatArray:
    """Return the sense of each face's normals: positive away from its axis or centre."""
    outward = np.zeros(len(formula))
    order, start = grouped(face, len(formula))
    for i, primitive in enumerate(formula):
        if primitive is not None and primitive.kind != "plane":
            mine = order[start[i] : start[i + 1]]
            leaving = (primitive.directions(middles[mine]) * normals[mine]).sum(axis=1)
            outward[i] = leaving @ areas[mine]
    return outward


def _face(
    number: int,
    primitive: Primitive | None,
    area_mm2: float,
    mean: FloatArray,
    centre_mm: FloatArray,
    outward: float,
) -> Face:
    length = float(np.linalg.norm(mean))
    direction = mean / length if length > CANCELS * area_mm2 else NO_DIRECTION
    kind = "freeform" if primitive is None else primitive.kind
    if primitive is None or kind == "plane":
        return Face(
            number, kind, area_mm2, direction, NO_DIRECTION, centre_mm, 0.0, 0.0, 0.0, concave=False
        )
    axis, middle, radius = primitive.axis, primitive.centre_mm, primitive.radius_mm
    if kind in ("cylinder", "cone"):
        along = float((centre_mm - middle) @ axis)
        middle = middle + along * axis
        radius = radius + along * float(np.tan(primitive.half_angle_rad))
    if kind in ("cylinder", "torus") and axis[int(np.argmax(np.abs(axis)))] < 0:
        axis = -axis
    return Face(
        number,
        kind,
        area_mm2,
        direction,
        axis,
        middle,
        float(radius),
        float(primitive.minor_radius_mm),
        float(primitive.half_angle_rad) if kind == "cone" else 0.0,
        concave=outward < 0,
        turn_rad=turn_of(length / area_mm2) if kind == "cylinder" else 0.0,
    )
