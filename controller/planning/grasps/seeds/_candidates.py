"""Candidates round each seed, with quick tests that save rays on the hopeless ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid

from ...model import GraspRules, Jaw
from ._faces import across
from ._seeds import Seeds, narrowest_inner, widest_inner

SHALLOWER_MM = 7.0  # the second depth tried: fingertips stand out less far behind the seed
TABLE_GAP_MM = 3.0  # distance from the fingertips to the far end of the part, if that is the table
APPROACH_POINT_COUNT = 200  # surface points tested in the approach
SLACK_MM = 0.5  # a surface point this far inside a box is in the way


@dataclass(slots=True)
class GraspCandidates:
    """TCP poses (n, 4, 4) in the part frame, gaps expected (n,), and which are inner (n,)."""

    T: FloatArray
    gap: FloatArray
    inner: BoolArray

    def take(self, rows: IntArray | BoolArray) -> GraspCandidates:
        """Return the candidates with the given numbers, or of a mask."""
        return GraspCandidates(self.T[rows], self.gap[rows], self.inner[rows])


def candidates(
    solid: Solid, seeds: Seeds, jaw: Jaw, downs: FloatArray, rules: GraspRules
) -> GraspCandidates:
    """Return gripper poses round each seed that the jaw is wide enough for, at a few depths.

    Approaches are spread round the jaws' axis, and those square to the table in each stable pose
    are among them.

    Parameters
    ----------
    solid : the part
    seeds : seeds to try
    jaw : the gripper that is to hold it
    downs : (k, 3) unit, the way down in the CAD frame, of each stable pose
    rules : number of approaches, and the opening to keep
    """
    able = np.where(
        seeds.inner,
        jaw.can_spread
        & (seeds.gap >= narrowest_inner(jaw, rules))
        & (seeds.gap <= widest_inner(jaw)),
        seeds.gap <= jaw.max_mm - rules.jaw_reserve_mm,
    )
    hull = solid.hull_mm
    poses, gaps, inner = [np.zeros((0, 4, 4))], [np.zeros(0)], [np.zeros(0, dtype=bool)]
    round_axis: dict[bytes, tuple[FloatArray, FloatArray]] = {}
    for k in np.flatnonzero(able):
        middle, axis = seeds.middle[k], seeds.axis[k]
        key = axis.tobytes()
        if key not in round_axis:
            approach = _approaches(axis, downs, rules.spin_count)
            round_axis[key] = approach, (hull @ approach.T).max(axis=0)
        approach, farthest = round_axis[key]
        ahead = farthest - approach @ middle
        deep = np.repeat(jaw.pad_centre_mm, len(approach))
        # flat parts on the table: as deep as the fingertips get without touching it
        table = (ahead > TABLE_GAP_MM) & (ahead - TABLE_GAP_MM < jaw.pad_centre_mm)
        approach = np.vstack([approach, approach, approach[table]])
        depth = np.concatenate([deep, deep - SHALLOWER_MM, ahead[table] - TABLE_GAP_MM])
        T = np.zeros((len(approach), 4, 4))
        T[:, 3, 3] = 1.0
        T[:, :3, 0], T[:, :3, 1] = approach, axis
        T[:, 0, 2] = approach[:, 1] * axis[2] - approach[:, 2] * axis[1]
        T[:, 1, 2] = approach[:, 2] * axis[0] - approach[:, 0] * axis[2]
        T[:, 2, 2] = approach[:, 0] * axis[1] - approach[:, 1] * axis[0]
        T[:, :3, 3] = middle + approach * depth[:, None]
        poses.append(T)
        gaps.append(np.repeat(seeds.gap[k], len(T)))
        inner.append(np.repeat(seeds.inner[k], len(T)))
    return GraspCandidates(np.concatenate(poses), np.concatenate(gaps), np.concatenate(inner))


def _approaches(axis: FloatArray, downs: FloatArray, spin_count: int) -> FloatArray:
    """Return unit vectors (n, 3) square to the axis, all round it and straight down if so."""
    turn = np.arange(spin_count) * 2 * np.pi / spin_count
    u, v = across(axis)
    square = downs[np.abs(downs @ axis) < 0.02]
    square = square - np.outer(square @ axis, axis)
    square /= np.linalg.norm(square, axis=1, keepdims=True)
    even = np.outer(np.cos(turn), u) + np.outer(np.sin(turn), v)
    fresh = (square @ even.T).max(axis=1, initial=0.0) < 1 - 1e-6
    return np.vstack([even, square[fresh]])


def axis_distance(T: FloatArray, centroid_mm: FloatArray, jaw: Jaw) -> FloatArray:
    """Return the distances (n,) of the centre of mass from the line through both pad centres [mm].

    Parameters
    ----------
    T : (n, 4, 4) T_part_tcp
    centroid_mm : (3,) CAD frame
    jaw : knows where on its fingers the pads are
    """
    at = T[:, :3, 3] - T[:, :3, 0] * jaw.pad_centre_mm
    return np.asarray(np.linalg.norm(np.cross(centroid_mm - at, T[:, :3, 1]), axis=1))


def approach_seems_free(
    found: GraspCandidates, seeds: Seeds, jaw: Jaw, rules: GraspRules
) -> BoolArray:
    """Return a mask (n,) of the candidates without a point of the surface in their approach.

    Necessary, not sufficient: some of the samples are looked at.

    Parameters
    ----------
    found : n candidates
    seeds : with samples of the part's surface
    jaw : the gripper; open, with fingers and body
    rules : length of the approach, and how far the jaw opens
    """
    gap = open_gap(found.gap, found.inner, jaw, rules)
    free = np.ones(len(found.T), dtype=bool)
    points = seeds.samples.points_mm
    points = points[:: max(1, len(points) // APPROACH_POINT_COUNT)].astype(np.float32)
    for rows in np.array_split(np.arange(len(free)), 1 + len(free) // 1000):
        R = found.T[rows, :3, :3].astype(np.float32)
        local = points @ R - np.einsum("ni,nij->nj", found.T[rows, :3, 3], R)[:, None].astype(
            np.float32
        )
        x, y, z = local[:, :, 0], np.abs(local[:, :, 1]), np.abs(local[:, :, 2])
        near = (gap[rows] / 2 + SLACK_MM)[:, None].astype(np.float32)
        hit = (x < -SLACK_MM) & (x > -jaw.finger_length_mm - rules.approach_mm)
        hit &= (z < jaw.finger_width_mm / 2 - SLACK_MM) & (y > near)
        hit &= y < near + jaw.finger_thickness_mm - 2 * SLACK_MM
        for box in jaw.body:
            at = (local - box.T[:3, 3].astype(np.float32)) @ box.T[:3, :3].astype(np.float32)
            hit |= np.all(np.abs(at) < (box.half_mm - SLACK_MM).astype(np.float32), axis=2)
        free[rows] = ~hit.any(axis=1)
    return free


def pre_open(opening: FloatArray, inner: BoolArray, jaw: Jaw, rules: GraspRules) -> FloatArray:
    """Return the width of the open jaw (n,) [mm]: wider than the grasp, narrower for an inner one.

    As `Grasp.pre_open_mm`: of an inner grasp the distance of the fingers' backs.

    Parameters
    ----------
    opening : (n,) opening between the walls held [mm]
    inner : (n,) the jaw spreads between them
    jaw : the gripper
    rules : clearance of each finger while open
    """
    outer = np.minimum(jaw.max_mm, opening + 2 * rules.clearance_mm)
    closed = np.maximum(2 * jaw.finger_thickness_mm, opening - 2 * rules.clearance_mm)
    return np.asarray(np.where(inner, closed, outer))


def open_gap(opening: FloatArray, inner: BoolArray, jaw: Jaw, rules: GraspRules) -> FloatArray:
    """Return the gap between the fingers' inner sides while the jaw is open (n,) [mm].

    Parameters
    ----------
    opening : (n,) opening between the walls held [mm]
    inner : (n,) the jaw spreads between them
    jaw : the gripper
    rules : clearance of each finger while open
    """
    back = np.where(inner, 2 * jaw.finger_thickness_mm, 0.0)
    return np.asarray(pre_open(opening, inner, jaw, rules) - back)
