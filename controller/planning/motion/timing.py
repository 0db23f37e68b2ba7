"""Duration of joint moves, and the deviation of gripper and part from the joint line.

The arm's timing model gives the duration and the joints in between (planning-facts.md 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import FloatArray

from ..model import CellLayout
from ._kinematics import tcp_pose

# Farthest points of gripper and part in the TCP frame [mm], for the stray of a turning wrist.
_OUT_MM = np.array(
    [[0.0, 0.0, 0.0], [40.0, 60.0, 0.0], [40.0, -60.0, 0.0], [40.0, 0.0, 60.0], [40.0, 0.0, -60.0]]
)
_COURSE_POINT_COUNT = 17  # points of a move's course in time
_BESIDE = np.linspace(-0.06, 0.06, 13)  # offsets along the line about the same instant


def segment_seconds(layout: CellLayout, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return the forecast of single moves (...) [s], 0 where nothing moves.

    Parameters
    ----------
    layout : the cell; its arm has the timing model
    q_from, q_to : (..., 6) rows of joints, broadcast against each other
    """
    return layout.arm.timing.move_seconds(q_from, q_to)


def travel_seconds(layout: CellLayout, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return the time of the slowest motor at full speed (...) [s].

    Parameters
    ----------
    layout : the cell; its arm has the timing model
    q_from, q_to : (..., 6) rows of joints, broadcast against each other
    """
    return layout.arm.timing.travel_seconds(q_from, q_to)


def move_seconds(layout: CellLayout, path: Sequence[FloatArray] | FloatArray) -> float:
    """Return the forecast of a drive along waypoints (k, 6), from the first one."""
    q = np.asarray(path)
    if len(q) < 2:
        return 0.0
    return float(segment_seconds(layout, q[:-1], q[1:]).sum())


def segment_tube(
    layout: CellLayout, q_from: FloatArray, q_to: FloatArray, at: FloatArray
) -> FloatArray:
    """Return the deviation of gripper and part from the straight joint line (k,) [mm].

    Parameters
    ----------
    layout : the cell; its arm has the timing model
    q_from, q_to : (6,) ends of one move
    at : (k,) shares of the line, 0 to 1
    """
    q, done = layout.arm.timing.courses(q_from, q_to, _COURSE_POINT_COUNT)
    # the line's nearest point is a little before or behind that of the same instant
    share = np.clip(done[:, None] + _BESIDE, 0.0, 1.0)
    line = _corners(layout, q_from + share[..., None] * (q_to - q_from))
    off = _corners(layout, q)[:, None] - line
    away = np.sqrt(np.einsum("nsij,nsij->nsi", off, off).max(axis=2))
    best = away.argmin(axis=1)
    every = np.arange(len(q))
    where = np.rint(share[every, best] * (_COURSE_POINT_COUNT - 1)).astype(int)
    tube = np.zeros(_COURSE_POINT_COUNT)
    for shift in (-1, 0, 1):  # between its points the course strays as far as at them
        np.maximum.at(tube, np.clip(where + shift, 0, _COURSE_POINT_COUNT - 1), away[every, best])
    return np.asarray(np.interp(at, np.linspace(0.0, 1.0, _COURSE_POINT_COUNT), tube))


def tube_bound_mm(layout: CellLayout, step: FloatArray, radii_mm: FloatArray) -> float:
    """Return an upper bound of `segment_tube` for a move by `step` (6,), at a fraction of its cost.

    Parameters
    ----------
    layout : the cell; its arm has the timing model
    step : (6,) change of the joints
    radii_mm : (6,) largest motion of gripper and part per change of a joint
    """
    return float(layout.arm.timing.stray(step) @ radii_mm)


def _corners(layout: CellLayout, q: FloatArray) -> FloatArray:
    """Return points (..., m, 3) that bound gripper and part."""
    T = tcp_pose(layout, q)
    return np.asarray(T[..., None, :3, 3] + _OUT_MM @ np.swapaxes(T[..., :3, :3], -1, -2))
