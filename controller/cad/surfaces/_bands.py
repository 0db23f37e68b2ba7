"""Narrow surfaces along an edge: chamfers cut it off, fillets round it."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from ..boundary import HALF_TURN_RAD, Crease, Curve, Face
from ..solid import Solid
from ._walls import Wall

PARALLEL = 1 - 1e-4
MIN_BEVEL_RAD = np.radians(15.0)  # a flatter slope is no chamfer
LARGEST_BEVEL_RAD = np.radians(75.0)
NARROW = 0.35  # largest width of a chamfer, as a share of the lesser extent of the planes beside it
CONE_NARROW = 0.35  # largest width of a chamfer round an axis, as a share of the radius
SMOOTH_SHARE = 0.4  # share of a fillet's outline along which it runs smoothly into other faces


@dataclass(frozen=True, eq=False, slots=True)
class Band:
    """A chamfer or a fillet: its face, sizes as in `Feature`, and the direction along it."""

    face: Face
    diameter_mm: float
    width_mm: float
    length_mm: float
    along: FloatArray


def half_edges_by_face(solid: Solid) -> list[list[int]]:
    """Return the half-edges round each face."""
    sides: list[list[int]] = [[] for _ in solid.faces]
    for half_edge, face in enumerate(solid.boundary.face.tolist()):
        sides[face].append(half_edge)
    return sides


def edge_lengths(solid: Solid) -> FloatArray:
    """Return the length of each edge (e,)."""
    b = solid.boundary
    if b.edge_count == 0:
        return np.zeros(0)
    points = np.asarray(solid.mesh.vertices)[b.chain]
    steps = np.linalg.norm(np.diff(points, axis=0, append=points[-1:]), axis=1)
    steps[b.chain_start[1:] - 1] = 0.0
    return np.asarray(np.add.reduceat(steps, b.chain_start[:-1]))


def chamfers(solid: Solid, walls: dict[int, Wall]) -> list[Band]:
    """Return the bevels between two planes, and those round the end of a shaft or a boss."""
    sides, lengths = half_edges_by_face(solid), edge_lengths(solid)
    found = []
    for face in solid.faces:
        if face.kind == "plane":
            band = _plane_chamfer(solid, face, sides[face.id], lengths)
            if band is not None:
                found.append(band)
        elif face.kind == "cone" and not face.concave and face.id in walls:
            rims = walls[face.id].rims
            radii = sorted(rim.radius_mm for rim in rims)
            if len(rims) != 2 or any(rim.crease != Crease.CONVEX for rim in rims):
                continue
            kinds = sorted(solid.faces[rim.beyond].kind for rim in rims)
            width = float(np.linalg.norm(rims[0].point_mm - rims[1].point_mm))
            width /= np.cos(face.half_angle_rad)
            if kinds == ["cylinder", "plane"] and width < CONE_NARROW * radii[1]:
                length = np.pi * (radii[0] + radii[1])
                found.append(Band(face, 2 * radii[1], width, float(length), face.axis))
    return found


def _plane_chamfer(solid: Solid, face: Face, sides: list[int], lengths: FloatArray) -> Band | None:
    b = solid.boundary
    long = sorted(
        (h for h in sides if b.curve[h // 2] == Curve.LINE), key=lambda h: -lengths[h // 2]
    )
    if len(long) < 2:
        return None
    one, other = long[:2]
    if any(b.crease[h // 2] != Crease.CONVEX for h in (one, other)):
        return None
    begin = b.vertices_mm[b.origin]
    along = begin[b.next[one]] - begin[one]
    along = along / np.linalg.norm(along)
    second = begin[b.next[other]] - begin[other]
    if abs(float(along @ second)) < PARALLEL * float(np.linalg.norm(second)):
        return None
    angles = b.angle_rad[[one // 2, other // 2]]
    if not ((angles > MIN_BEVEL_RAD) & (angles < LARGEST_BEVEL_RAD)).all():
        return None
    beside = [solid.faces[b.face[h ^ 1]] for h in (one, other)]
    if any(neighbour.kind != "plane" for neighbour in beside):
        return None
    offset = begin[other] - begin[one]
    width = float(np.linalg.norm(offset - (offset @ along) * along))
    length = face.area_mm2 / max(width, 1e-9)
    # each plane beside it goes on from the edge much further than the bevel is wide
    depths = [neighbour.area_mm2 / length for neighbour in beside]
    if width > NARROW * min(depths) or width > length:
        return None
    return Band(face, 0.0, width, length, along)


def fillets(solid: Solid, walls: dict[int, Wall]) -> list[Band]:
    """Return the rounds that run smoothly into the surfaces on both sides."""
    b, sides, lengths = solid.boundary, half_edges_by_face(solid), edge_lengths(solid)
    spread = _turns(solid)
    found = []
    for face in solid.faces:
        if face.kind not in ("cylinder", "torus", "sphere"):
            continue
        if face.kind == "cylinder" and (face.id in walls or face.turn_rad > HALF_TURN_RAD):
            continue
        if face.kind == "sphere" and spread[face.id] > HALF_TURN_RAD:
            continue
        edges = np.array([h // 2 for h in sides[face.id]], dtype=np.int64)
        if len(edges) == 0:
            continue
        smooth = b.crease[edges] == Crease.SMOOTH
        beyond = {int(b.face[h ^ 1]) for h, s in zip(sides[face.id], smooth, strict=True) if s}
        if len(beyond) < 2 or lengths[edges][smooth].sum() < SMOOTH_SHARE * lengths[edges].sum():
            continue
        radius = face.minor_radius_mm if face.kind == "torus" else face.radius_mm
        length = 0.0 if face.kind == "sphere" else float(lengths[edges][smooth].sum()) / 2
        found.append(Band(face, 2 * radius, 0.0, length, face.axis))
    return found


def _turns(solid: Solid) -> FloatArray:
    """Return the turn of each face's normals about its mean normal, to both sides (f,) [rad]."""
    normals = np.asarray(solid.mesh.face_normals)
    mean = np.array([face.normal for face in solid.faces])[solid.face_of_triangle]
    cosine = np.clip((normals * mean).sum(axis=1), -1.0, 1.0)
    widest = np.zeros(len(solid.faces))
    np.maximum.at(widest, solid.face_of_triangle, np.arccos(cosine))
    return 2 * widest
