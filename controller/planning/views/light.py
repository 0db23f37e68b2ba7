"""What a view shows of bores: the panel's light through them, or the edge of a floor.

Inspection takes a bore for drilled through where the panel's light is seen along its rims, and a
blind one for deep enough where a slanting view shows the edge of its floor
(`inspection/edge_evidence`). So what a plan has to show of one is no point of its wall, which may
be too deep to be seen at all, but the light just inside its rims, or its floor's edge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray, square_to
from controller.cad import Crease, Face, Solid
from controller.imaging import RayCaster, inverse_pose, transform

from ..geometry import Box, segments_hit
from ..model import BoreOpenings
from .gripper import FINGER_SHADOW_MM
from .visibility import SEARCHED_COUNT, VisibilityRules, even_sphere, eyes_of, helping_most

SECTOR_COUNT = 12  # places round a rim; more than half of them prove a bore
# Places of a floor's edge in one view: a third of it, to fit its height to. Where a view at 32
# degrees showed three, of a bore of 4 x 5 mm, its picture had 4 points of 33.
FLOOR_COUNT = 4
INSET_MM = 0.5  # some three pixels: so wide must the light beside a rim be
INSET_SHARE = 0.3  # and no more of the radius than this, in a small bore
BEHIND_MM = 250.0  # how far behind the part something may stand in the light
# Along the axis a floor shows at the same place however deep it is. From this tilt on, half a
# millimetre of depth moves its edge by half a pixel.
MIN_TILT_RAD = float(np.radians(10.0))
MAX_TILT_RAD = float(np.radians(25.0))  # enough, where the bore is wide
AIM = 0.5  # share of a floor's width that a view made for it sees past the mouth
ASKED_VIEWS = 2  # directions of each element: one may be lost to a finger or a joint limit
WAY_COUNT = 4  # directions round the axis that are tried for a floor


def find_openings(solid: Solid) -> BoreOpenings:
    """Return what views have to show of all bores with closed rims."""
    b = solid.boundary
    sides = b.face.reshape(-1, 2)
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    faces: list[int] = []
    needed: list[int] = []
    elements, points, axes = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros((0, 3))]
    for face in solid.faces:
        if face.kind != "cylinder" or not face.concave:
            continue
        around = np.flatnonzero((sides == face.id).any(axis=1)).tolist()
        ways = {edge: vertices[b.chain_of(edge)] for edge in around}
        rings = {k: way for k, way in ways.items() if len(way) > 3 and (way[0] == way[-1]).all()}
        floors = [way for edge, way in rings.items() if b.crease[edge] == Crease.CONCAVE]
        mouths = [way for edge, way in rings.items() if b.crease[edge] != Crease.CONCAVE]
        if not mouths:
            continue
        first = len(faces)
        if floors:
            out = _middle(mouths[0]) - _middle(floors[0])
            out /= np.linalg.norm(out)
            faces.append(face.id)
            needed.append(FLOOR_COUNT)
            points.append(_inside(face, floors[0]) + INSET_MM * out)
            elements.append(np.full(SECTOR_COUNT, first))
            axes.append(np.tile(out, (SECTOR_COUNT, 1)))
            continue
        faces += [face.id] * SECTOR_COUNT
        needed += [1] * SECTOR_COUNT
        wall = _wall(solid, face.id)
        for ring in mouths:
            points.append(_inside(face, _at_wall(face, ring, wall)))
            elements.append(first + np.arange(SECTOR_COUNT))
            axes.append(np.zeros((SECTOR_COUNT, 3)))
    return BoreOpenings(
        np.array(faces, dtype=np.int64),
        np.array(needed, dtype=np.int64),
        np.concatenate(elements),
        np.vstack(points),
        np.vstack(axes),
    )


def lit_from(openings: BoreOpenings, caster: RayCaster, eyes: FloatArray) -> BoolArray:
    """Return a mask (v, k) of the places that eyes (v, 3) see, past the part where inside a rim.

    Parameters
    ----------
    openings : of the part
    caster : rays against its mesh
    eyes : (v, 3) positions of the camera, CAD frame [mm]
    """
    count = len(openings.points_mm)
    eye, place = np.divmod(np.arange(len(eyes) * count), max(count, 1))
    start, along = eyes[eye], openings.points_mm[place] - eyes[eye]
    free = np.zeros(len(eye), dtype=bool)
    floor = openings.is_floor[place]
    free[~floor] = ~caster.blocked(start[~floor], along[~floor])
    cosine = -np.einsum("ij,ij->i", along[floor], openings.axes[place[floor]])
    cosine /= np.linalg.norm(along[floor], axis=1)
    tilted = np.flatnonzero(floor)[(cosine > 0.0) & (cosine <= np.cos(MIN_TILT_RAD))]
    free[tilted] = ~caster.blocked(start[tilted], along[tilted], np.ones(len(tilted)))
    return free.reshape(len(eyes), count)


def lit_past(
    openings: BoreOpenings,
    lit: BoolArray,
    eyes: FloatArray,
    T_part_frame: FloatArray,
    boxes: Sequence[Box],
) -> BoolArray:
    """Return a mask (v, k) of the places that boxes leave lit, before the part and behind it.

    Parameters
    ----------
    openings : of the part
    lit : (v, k) places to test
    eyes : (v, 3) positions of the camera, CAD frame [mm]
    T_part_frame : (4, 4) frame of the boxes in the part
    boxes : in their frame
    """
    view, place = np.nonzero(lit)
    left = np.zeros_like(lit)
    start, through = eyes[view], openings.points_mm[place]
    along = through - start
    behind = np.where(openings.is_floor[place], 0.0, BEHIND_MM)
    end = through + along * (behind / np.linalg.norm(along, axis=1))[:, None]
    T = inverse_pose(T_part_frame)
    hit = segments_hit(transform(T, end), transform(T, start), tuple(boxes), FINGER_SHADOW_MM)
    left[view, place] = ~hit
    return left


def by_element(openings: BoreOpenings, lit: BoolArray) -> BoolArray:
    """Return a mask (v, e) of the elements of which enough places are lit (v, k)."""
    shown = np.zeros((len(lit), len(openings.faces)), dtype=np.int64)
    for place, element in enumerate(openings.element.tolist()):
        shown[:, element] += lit[:, place]
    return np.asarray(shown >= openings.needed)


def directions_to_openings(
    openings: BoreOpenings,
    solid: Solid,
    caster: RayCaster,
    vectors: FloatArray,
    rules: VisibilityRules,
) -> FloatArray:
    """Return directions (k, 3) for what fewer than two of some directions show of bores.

    Parameters
    ----------
    openings : of the part
    solid, caster : the part, and rays against its mesh
    vectors : (v, 3) unit, from the centre of mass to the camera: those there are
    rules : distance of the camera from the centre of mass
    """
    shown = by_element(openings, lit_from(openings, caster, eyes_of(solid, vectors, rules)))
    count = shown.sum(axis=0)
    most = np.where(openings.needed > 1, WAY_COUNT, ASKED_VIEWS)
    wanted = np.where(count < ASKED_VIEWS, most - count, 0)
    added = [np.zeros((0, 3))]
    for face in np.unique(openings.faces[wanted > 0]).tolist():
        elements = np.flatnonzero(openings.faces == face)
        places = np.isin(openings.element, elements)
        middle = _middle(openings.points_mm[places])
        if openings.is_floor[places].any():
            ways = _ways_to_floor(openings, solid, face, places)
        else:
            ways = even_sphere(SEARCHED_COUNT)
        found = middle + rules.distance_mm * ways - solid.centroid_mm
        found /= np.linalg.norm(found, axis=1)[:, None]
        mine = openings.only(places)
        lit = by_element(mine, lit_from(mine, caster, eyes_of(solid, found, rules)))
        none_urgent = np.zeros(len(elements), dtype=bool)
        added.append(found[helping_most(lit[:, elements], wanted[elements], none_urgent)])
    return np.concatenate(added)


def _ways_to_floor(
    openings: BoreOpenings, solid: Solid, face: int, places: BoolArray
) -> FloatArray:
    """Return the directions (k, 3) from which a floor's edge should show past its mouth.

    Parameters
    ----------
    openings, solid : of the part
    face : wall of the bore
    places : (p,) True for those above its floor
    """
    ring = openings.points_mm[places]
    axis = openings.axes[places][0]
    middle = ring.mean(axis=0)
    width = 2.0 * float(np.linalg.norm(ring - middle, axis=1).mean())
    depth = float(((_wall(solid, face) - middle) @ axis).max())
    tilt = float(np.clip(np.arctan(AIM * width / depth), MIN_TILT_RAD * 1.1, MAX_TILT_RAD))
    sides = _around(axis, np.arange(WAY_COUNT) * 2.0 * np.pi / WAY_COUNT)
    return np.asarray(np.cos(tilt) * axis + np.sin(tilt) * sides)


def _at_wall(face: Face, ring: FloatArray, wall: FloatArray) -> FloatArray:
    """Return a rim (n, 3) as far inside as its wall goes all round: saddles become level.

    Light that passes a saddle alone need not have passed the bore.

    Parameters
    ----------
    face : wall of the bore
    ring : (n, 3) one of its rims
    wall : (m, 3) corners of its triangles
    """
    levels, along = ring @ face.axis, wall @ face.axis
    middle = 0.5 * float(along.min() + along.max())  # of a bore cut off aslant, no farther
    if levels.mean() < middle:
        inside = np.maximum(levels, min(levels.max(), middle))
    else:
        inside = np.minimum(levels, max(levels.min(), middle))
    return np.asarray(ring + (inside - levels)[:, None] * face.axis)


def _wall(solid: Solid, face: int) -> FloatArray:
    """Return the corners (m, 3) of a face's triangles."""
    return np.asarray(solid.mesh.triangles[solid.face_of_triangle == face].reshape(-1, 3))


def _middle(ring: FloatArray) -> FloatArray:
    """Return the middle of a ring's box: the mean of unevenly spaced points is not its middle."""
    return np.asarray(0.5 * (ring.min(axis=0) + ring.max(axis=0)))


def _around(axis: FloatArray, turns: FloatArray) -> FloatArray:
    """Return the directions (k, 3) square to an axis at some turns (k,) about it [rad]."""
    u, v = square_to(axis)
    return np.asarray(np.outer(np.cos(turns), u) + np.outer(np.sin(turns), v))


def _inside(face: Face, ring: FloatArray) -> FloatArray:
    """Return places (`SECTOR_COUNT`, 3) evenly round a rim of a bore, just inside its wall."""
    turns = (np.arange(SECTOR_COUNT) + 0.5) * 2 * np.pi / SECTOR_COUNT
    ways = _around(face.axis, turns)
    off = ring - _middle(ring)
    nearest = np.argmax(ways @ off.T, axis=1)
    inset = np.minimum(INSET_MM, INSET_SHARE * (off[nearest] * ways).sum(axis=1))
    return np.asarray(ring[nearest] - inset[:, None] * ways)
