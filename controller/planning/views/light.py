"""Light through bores: where a view shows the panel beside the rim of a bore.

Inspection takes a bore for drilled through where the panel's light is seen along its rims
(`inspection/edge_evidence`). So what a plan has to show of one is no point of its wall, which may
be too deep to be seen at all, but the light just inside its rims.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid
from controller.imaging import RayCaster, inverse_pose, transform

from ..geometry import Box, segments_hit
from ..model import Openings
from .gripper import FINGER_SHADOW_MM

SECTOR_COUNT = 12  # places round a rim; more than half of them prove a bore
INSET_MM = 0.5  # some three pixels: so wide must the light beside a rim be
INSET_SHARE = 0.3  # and no more of the radius than this, in a small bore
BEHIND_MM = 250.0  # how far behind the part something may stand in the light


def find_openings(solid: Solid) -> Openings:
    """Return the sectors of all bores with a closed rim."""
    b = solid.boundary
    sides = b.face.reshape(-1, 2)
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    faces: list[int] = []
    sectors, points = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    turns = (np.arange(SECTOR_COUNT) + 0.5) * 2 * np.pi / SECTOR_COUNT
    for face in solid.faces:
        if face.kind != "cylinder" or not face.concave:
            continue
        around = np.flatnonzero((sides == face.id).any(axis=1)).tolist()
        rings = [vertices[b.chain_of(edge)] for edge in around]
        rings = [ring for ring in rings if len(ring) > 3 and (ring[0] == ring[-1]).all()]
        if not rings:
            continue
        first = len(faces)
        faces += [face.id] * SECTOR_COUNT
        u = np.cross(face.axis, np.eye(3)[np.argmin(np.abs(face.axis))])
        u /= np.linalg.norm(u)
        ways = np.outer(np.cos(turns), u) + np.outer(np.sin(turns), np.cross(face.axis, u))
        for ring in rings:
            # halfway between the ends of its box: the mean of unevenly spaced points is not
            middle = ring @ np.column_stack([u, np.cross(face.axis, u)])
            middle = 0.5 * (middle.min(axis=0) + middle.max(axis=0))
            off = ring - np.outer(middle[0], u) - np.outer(middle[1], np.cross(face.axis, u))
            nearest = np.argmax(ways @ off.T, axis=1)
            radial = (off[nearest] * ways).sum(axis=1)
            inset = np.minimum(INSET_MM, INSET_SHARE * radial)
            points.append(ring[nearest] - inset[:, None] * ways)
            sectors.append(first + np.arange(SECTOR_COUNT))
    return Openings(np.array(faces, dtype=np.int64), np.concatenate(sectors), np.vstack(points))


def lit_from(openings: Openings, caster: RayCaster, eyes: FloatArray) -> BoolArray:
    """Return a mask (v, k) of the places through which eyes (v, 3) look past the part.

    Parameters
    ----------
    openings : of the part
    caster : rays against its mesh
    eyes : (v, 3) positions of the camera, CAD frame [mm]
    """
    count = len(openings.points_mm)
    eye, place = np.divmod(np.arange(len(eyes) * count), max(count, 1))
    start = eyes[eye]
    free = ~caster.blocked(start, openings.points_mm[place] - start)
    return np.asarray(free.reshape(len(eyes), count))


def lit_past(
    openings: Openings,
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
    end = through + along * (BEHIND_MM / np.linalg.norm(along, axis=1, keepdims=True))
    T = inverse_pose(T_part_frame)
    hit = segments_hit(transform(T, end), transform(T, start), tuple(boxes), FINGER_SHADOW_MM)
    left[view, place] = ~hit
    return left


def by_sector(openings: Openings, lit: BoolArray) -> BoolArray:
    """Return a mask (v, e) of the sectors with a lit place (v, k)."""
    shown = np.zeros((len(lit), len(openings.faces)), dtype=bool)
    for place, sector in enumerate(openings.sector.tolist()):
        shown[:, sector] |= lit[:, place]
    return shown
