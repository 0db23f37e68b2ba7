"""Batched tests of boxes against boxes, and of segments against boxes.

Links, grippers, obstacles and (away from the fingers) the part are boxes, so the separating-axis
test is exact and, vectorised, cheaper per configuration than one call into a collision library.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from controller.arrays import BoolArray, FloatArray

_EPS = 1e-9  # parallel edges make a zero cross product; this keeps such an axis from separating


class SolidBox(Protocol):
    """A solid box in some frame."""

    @property
    def T(self) -> FloatArray:
        """Pose of the box's centre in that frame, (4, 4)."""

    @property
    def half_mm(self) -> FloatArray:
        """Half of each edge (3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A solid box in some frame.

    Attributes
    ----------
    T : (4, 4) pose of the box's centre in that frame
    half_mm : (3,) half of each edge
    """

    T: FloatArray
    half_mm: FloatArray

    @classmethod
    def from_bounds(cls, x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Self:
        """Return the axis-aligned box between bounds.

        Parameters
        ----------
        x0, x1, y0, y1, z0, z1 : low and high on each axis of the box's frame [mm]

        Raises
        ------
        ValueError : low is not below high on some axis
        """
        low, high = np.array([x0, y0, z0], float), np.array([x1, y1, z1], float)
        if np.any(high <= low):
            raise ValueError(f"a box needs low < high on every axis, got {low} and {high}")
        T = np.eye(4)
        T[:3, 3] = (low + high) / 2
        return cls(T, (high - low) / 2)

    def wider_in_xz(self, by_mm: float, turned_rad: float) -> Box:
        """Return a box that holds this one at any shift in its frame's plane xz.

        Parameters
        ----------
        by_mm : moved by at most so much
        turned_rad : turned about the frame's y axis by at most so much, to either side
        """
        if by_mm == 0.0 and turned_rad == 0.0:
            return self
        R = self.T[:3, :3]
        reach = np.abs(self.T[:3, 3]) + np.abs(R) @ self.half_mm  # of its corners, at most
        more = by_mm + float(np.hypot(reach[0], reach[2])) * turned_rad  # no chord is longer
        # a shift to any side in the plane, as the box's own axes have it
        across = np.hypot(R[0], R[2])
        return Box(self.T, self.half_mm + more * across)

    def placed(self, T_world_frame: FloatArray) -> Box:
        """Return this box carried from its frame to the world."""
        return Box(T_world_frame @ self.T, self.half_mm)


def stack(boxes: Sequence[SolidBox]) -> tuple[FloatArray, FloatArray]:
    """Return the poses (n, 4, 4) and half edges (n, 3) of boxes."""
    if len(boxes) == 0:
        return np.zeros((0, 4, 4)), np.zeros((0, 3))
    return np.stack([b.T for b in boxes]), np.stack([b.half_mm for b in boxes])


def overlap(T_a: FloatArray, half_a: FloatArray, T_b: FloatArray, half_b: FloatArray) -> BoolArray:
    """Return a mask (n,) of the pairs of boxes that touch.

    Parameters
    ----------
    T_a, T_b : (n, 4, 4) poses of their centres in one frame
    half_a, half_b : (n, 3), or (3,) for all alike: half of each edge [mm]
    """
    offset = T_b[:, :3, 3] - T_a[:, :3, 3]
    half_a = np.broadcast_to(half_a, offset.shape)
    half_b = np.broadcast_to(half_b, offset.shape)
    return overlap_turned(T_a[:, :3, :3], half_a, T_b[:, :3, :3], half_b, offset)


def overlap_turned(
    R_a: FloatArray, a: FloatArray, R_b: FloatArray, b: FloatArray, offset: FloatArray
) -> BoolArray:
    """Return a mask (n,) of the pairs of boxes that touch.

    Gottschalk's 15 axes, all pairs at once; pairs that a face separates never see the edges' nine.

    Parameters
    ----------
    R_a, R_b : (n, 3, 3) rotations in one frame
    a, b : (n, 3) half of each edge [mm]
    offset : (n, 3) offset from the centre of each a to that of its b, in that frame [mm]
    """
    turn = np.swapaxes(R_a, 1, 2) @ R_b
    across = np.abs(turn) + _EPS
    t = (offset[:, None] @ R_a)[:, 0]
    seen_from_a = np.abs(t) <= a + (across @ b[..., None])[..., 0]
    seen_from_b = np.abs((t[:, None] @ turn)[:, 0]) <= b + (a[:, None] @ across)[:, 0]
    meet = seen_from_a & seen_from_b
    touch: BoolArray = meet[:, 0] & meet[:, 1] & meet[:, 2]  # faster than `all` over three
    (left,) = np.nonzero(touch)
    if len(left):
        turn, across, t, a, b = turn[left], across[left], t[left], a[left], b[left]
        one, two = [1, 2, 0], [2, 0, 1]
        distance = np.abs(t[:, two, None] * turn[:, one] - t[:, one, None] * turn[:, two])
        reach = a[:, one, None] * across[:, two] + a[:, two, None] * across[:, one]
        reach += b[:, None, one] * across[:, :, two] + b[:, None, two] * across[:, :, one]
        touch[left] = np.all(distance <= reach, axis=(1, 2))
    return touch


def segments_hit(
    start: FloatArray, end: FloatArray, boxes: list[Box] | tuple[Box, ...], grow_mm: float = 0.0
) -> BoolArray:
    """Return a mask (n,) of the segments that pass through any of the boxes.

    Parameters
    ----------
    start : (n, 3) in the boxes' frame [mm]
    end : (n, 3), or (3,) for all alike
    boxes : none hits nothing
    grow_mm : growth of every box on all sides
    """
    hit = np.zeros(len(start), dtype=bool)
    end = np.broadcast_to(end, start.shape)
    for box in boxes:
        R, centre, half = box.T[:3, :3], box.T[:3, 3], box.half_mm + grow_mm
        origin, target = (start - centre) @ R, (end - centre) @ R
        # most segments end on one side of most boxes
        near = np.ones(len(start), dtype=bool)
        for k in range(3):
            near &= np.minimum(origin[:, k], target[:, k]) <= half[k] + _EPS
            near &= np.maximum(origin[:, k], target[:, k]) >= -half[k] - _EPS
        (left,) = np.nonzero(near & ~hit)
        if not len(left):
            continue
        origin, step = origin[left], (end[left] - start[left]) @ R
        step = np.where(np.abs(step) < 1e-12, 1e-12, step)
        t1, t2 = (-half - origin) / step, (half - origin) / step
        enter = np.minimum(t1, t2).max(axis=1)
        leave = np.maximum(t1, t2).min(axis=1)
        hit[left] = (enter <= leave) & (leave >= 0.0) & (enter <= 1.0)
    return hit


def lowest_z(T: FloatArray, half: FloatArray) -> FloatArray:
    """Return the height of the lowest corner [mm] of boxes (..., 4, 4), (..., 3)."""
    z: FloatArray = T[..., 2, 3] - np.einsum("...i,...i->...", np.abs(T[..., 2, :3]), half)
    return z
