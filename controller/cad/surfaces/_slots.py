"""Slots: long holes with round ends, and grooves between two facing walls."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controller.arrays import FloatArray

from ..boundary import Crease, Curve, Face
from ..solid import Solid
from ._bands import half_edges_by_face
from ._walls import Wall

PARALLEL = 1 - 1e-5
SAME_MM = 0.01  # largest difference of radius and place of both ends


@dataclass(frozen=True, eq=False, slots=True)
class Slot:
    """A slot, a keyway, a pocket or an opening, with sizes as in `Feature`."""

    kind: Literal["slot", "keyway", "pocket", "opening"]
    faces: tuple[int, ...]
    width_mm: float
    length_mm: float
    depth_mm: float
    inward: FloatArray
    position_mm: FloatArray
    is_through: bool
    across: tuple[tuple[int, int], ...]
    ends: tuple[int, ...]


def points_of(solid: Solid, face: int) -> FloatArray:
    """Return the corners of a face's triangles (n, 3)."""
    mine = np.asarray(solid.mesh.triangles, dtype=np.float64)[solid.face_of_triangle == face]
    return np.asarray(mine.reshape(-1, 3))


def round_ended(solid: Solid, walls: dict[int, Wall]) -> list[Slot]:
    """Return the slots with round ends.

    Parameters
    ----------
    solid : the part
    walls : surfaces that close round their axis, by face
    """
    b, sides = solid.boundary, half_edges_by_face(solid)
    beside: dict[tuple[int, ...], list[Face]] = {}
    for face in solid.faces:
        if face.kind != "cylinder" or not face.concave or face.id in walls:
            continue
        smooth = {int(b.face[h ^ 1]) for h in sides[face.id] if b.crease[h // 2] == Crease.SMOOTH}
        planes = tuple(sorted(i for i in smooth if solid.faces[i].kind == "plane"))
        if len(planes) == 2:
            beside.setdefault(planes, []).append(face)
    found = []
    for planes, ends in beside.items():
        if len(ends) != 2 or abs(ends[0].radius_mm - ends[1].radius_mm) > SAME_MM:
            continue
        normals = [solid.faces[i].normal for i in planes]
        if normals[0] @ normals[1] > -PARALLEL or abs(ends[0].axis @ ends[1].axis) < PARALLEL:
            continue
        axis = ends[0].axis
        across = ends[1].centre_mm - ends[0].centre_mm
        across = across - (across @ axis) * axis
        members = (*planes, ends[0].id, ends[1].id)
        heights = np.concatenate([points_of(solid, i) for i in members]) @ axis
        level = ends[0].centre_mm - (ends[0].centre_mm @ axis) * axis + across / 2
        lower_bounds = _floors(solid, sides, members, axis)
        low, high = float(heights.min()), float(heights.max())
        floor_low = any(abs(solid.faces[i].centre_mm @ axis - low) < SAME_MM for i in lower_bounds)
        floor_high = any(
            abs(solid.faces[i].centre_mm @ axis - high) < SAME_MM for i in lower_bounds
        )
        if floor_low and floor_high:
            continue
        from_low = floor_high
        found.append(
            Slot(
                kind=_kind(solid, sides, planes, across),
                faces=tuple(sorted((*members, *lower_bounds))),
                width_mm=2 * ends[0].radius_mm,
                length_mm=float(np.linalg.norm(across)) + 2 * ends[0].radius_mm,
                depth_mm=high - low,
                inward=axis if from_low else -axis,
                position_mm=level + axis * (low if from_low else high),
                is_through=not (floor_low or floor_high),
                across=((planes[0], planes[1]),),
                ends=tuple(lower_bounds) if floor_low or floor_high else (),
            )
        )
    return found


def _floors(
    solid: Solid, sides: list[list[int]], members: tuple[int, ...], axis: FloatArray
) -> list[int]:
    b = solid.boundary
    lower_bounds = set()
    for member in members:
        for h in sides[member]:
            beyond = solid.faces[b.face[h ^ 1]]
            if b.crease[h // 2] == Crease.CONCAVE and abs(beyond.normal @ axis) > PARALLEL:
                lower_bounds.add(beyond.id)
    return sorted(lower_bounds)


def _kind(
    solid: Solid, sides: list[list[int]], walls: tuple[int, ...], along: FloatArray
) -> Literal["slot", "keyway"]:
    """Return the kind of a slot: a keyway where both walls open along it into a round surface."""
    b = solid.boundary
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    for wall in walls:
        mouths = []
        for h in sides[wall]:
            if b.crease[h // 2] == Crease.CONVEX and b.curve[h // 2] == Curve.LINE:
                way = b.vertices_mm[b.origin[h ^ 1]] - b.vertices_mm[b.origin[h]]
                if abs(float(way @ along)) > PARALLEL * float(np.linalg.norm(way)):
                    mouths.append(solid.faces[b.face[h ^ 1]].kind)
        if not mouths or any(kind != "cylinder" for kind in mouths):
            return "slot"
    return "keyway"


def grooves(solid: Solid, taken: set[int]) -> list[Slot]:
    """Return floors between two walls that face each other, with no wall at their ends.

    Parameters
    ----------
    solid : the part
    taken : faces that are part of other slots, of pockets and of openings
    """
    b, sides = solid.boundary, half_edges_by_face(solid)
    found = []
    for floor in solid.faces:
        if floor.kind != "plane" or floor.id in taken:
            continue
        inner = [h for h in sides[floor.id] if b.crease[h // 2] == Crease.CONCAVE]
        walls = sorted({int(b.face[h ^ 1]) for h in inner})
        if len(walls) != 2 or any(b.curve[h // 2] != Curve.LINE for h in inner):
            continue
        one, other = (solid.faces[i] for i in walls)
        if one.kind != "plane" or other.kind != "plane":
            continue
        gap = other.centre_mm - one.centre_mm
        width = float(gap @ one.normal)
        square = abs(one.normal @ floor.normal) < 1 - PARALLEL
        if one.normal @ other.normal > -PARALLEL or width <= SAME_MM or not square:
            continue
        along = np.cross(floor.normal, one.normal)
        reach = points_of(solid, floor.id) @ along
        base = float(floor.centre_mm @ floor.normal)
        tops = [float((points_of(solid, i) @ floor.normal).max()) - base for i in walls]
        depth = min(tops)
        if depth <= SAME_MM:
            continue
        found.append(
            Slot(
                kind=_kind(solid, sides, (one.id, other.id), along),
                faces=tuple(sorted((floor.id, *walls))),
                width_mm=width,
                length_mm=float(np.ptp(reach)),
                depth_mm=depth,
                inward=-floor.normal,
                position_mm=floor.centre_mm + depth * floor.normal,
                across=((one.id, other.id),),
                ends=(floor.id,),
                is_through=_open_at_both_ends(solid, sides[floor.id], along, reach),
            )
        )
    return found


def _open_at_both_ends(
    solid: Solid, edges: list[int], along: FloatArray, reach: FloatArray
) -> bool:
    """Return True if a floor drops off at both ends of its reach along its walls."""
    b = solid.boundary
    dropping = [h for h in edges if b.crease[h // 2] == Crease.CONVEX]
    chains = [b.chain_of(h // 2)[[0, -1]] for h in dropping]
    ends = np.asarray(solid.mesh.vertices)[np.array(chains, dtype=np.int64).reshape(-1)] @ along
    return len(ends) > 0 and bool(
        ends.min() < reach.min() + SAME_MM and ends.max() > reach.max() - SAME_MM
    )
