"""How long joint moves take, and how far from the joint line the arm strays meanwhile.

A move is one command: target and speed per motor, the speeds such that all motors arrive
together (drivers/umi_scara/_motion.py; planning-facts.md 3.3). Every motor then follows the same
trapezoid, stretched; the servo's lag is linear and the same for all, so that it keeps the arm on
the line. Two things take it off: speeds are whole numbers, rounded up, and the wrist's motors hang
on another processor, which is told to go a little earlier or later (umi_rtx.md 1.3, 2.5).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import FloatArray

from ..model import CellLayout, Pace
from ._kinematics import tip_pose

STILL = 1e-6  # rad, mm: less than a count of any motor
# joints = these @ motors: pitch is half the sum, roll half the difference (umi_rtx.md 5.3)
_SPLIT = np.eye(6)
_SPLIT[4:, 4:] = [[1.0, 1.0], [1.0, -1.0]]
_JOIN = np.linalg.inv(_SPLIT)
_FULL_SPEED = 100.0  # SPEED of the motor that needs longest; the others get a share, rounded up
# of hand and part, in the tip frame [mm]: how far out they may be, for the stray of a turning wrist
_OUT_MM = np.array(
    [[0.0, 0.0, 0.0], [40.0, 60.0, 0.0], [40.0, -60.0, 0.0], [40.0, 0.0, 60.0], [40.0, 0.0, -60.0]]
)
_COURSE_N = 17  # points of a move's course in time
_BESIDE = np.linspace(-0.06, 0.06, 13)  # shares of the line


def motor_travel(step: FloatArray) -> FloatArray:
    """Return how far the motors turn (..., 6) for changes of the joints (..., 6) [rad, mm]."""
    return np.asarray(np.asarray(step, np.float64) @ _SPLIT.T)


def leg_seconds(layout: CellLayout, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return the forecast of single moves between joints (..., 6): (...), 0 where nothing moves."""
    pace = layout.pace
    travel = np.abs(motor_travel(np.asarray(q_to) - np.asarray(q_from)))
    shares_s = travel / _motor_speeds(pace)
    moved = travel > STILL
    told = moved.sum(axis=-1)
    both = moved[..., :4].any(axis=-1) & moved[..., 4:].any(axis=-1)
    seconds = _trapezoid_s(shares_s.max(axis=-1), pace.ramp_s)
    seconds = seconds + pace.command_s + pace.motor_s * told + pace.hand_over_s * both
    return np.asarray(np.where(told > 0, seconds, 0.0))


def travel_seconds(layout: CellLayout, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return the seconds of the slowest motor at full speed between joints (..., 6): (...)."""
    travel = np.abs(motor_travel(np.asarray(q_to) - np.asarray(q_from)))
    return np.asarray((travel / _motor_speeds(layout.pace)).max(axis=-1))


def move_seconds(layout: CellLayout, path: Sequence[FloatArray] | FloatArray) -> float:
    """Return the forecast of driving along waypoints (k, 6), the first being where it starts."""
    q = np.asarray(path)
    if len(q) < 2:
        return 0.0
    return float(leg_seconds(layout, q[:-1], q[1:]).sum())


def _motor_speeds(pace: Pace) -> FloatArray:
    # pitch alone runs both wrist motors at pitch's speed, and so does roll
    return np.asarray(pace.joint_per_s, dtype=np.float64)


def _trapezoid_s(share_s: FloatArray, ramp_s: float) -> FloatArray:
    """Return the time for a way that takes `share_s` at full speed, starting and ending at rest."""
    peaked = 2.0 * np.sqrt(share_s * ramp_s)  # too short to reach full speed
    return np.where(share_s >= ramp_s, share_s + ramp_s, peaked)


def leg_course(
    layout: CellLayout, q_from: FloatArray, q_to: FloatArray, steps_n: int, skew_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return where one move has the joints (n, 6) as time goes by, and the share done (n,).

    The share is that of the motor which needs longest; `skew_s` later, or sooner, goes the wrist.
    """
    pace = layout.pace
    travel = motor_travel(q_to - q_from)
    shares_s = np.abs(travel) / _motor_speeds(pace)
    longest_s = float(shares_s.max())
    if longest_s <= 0.0:
        return np.repeat(q_from[None], steps_n, axis=0), np.linspace(0.0, 1.0, steps_n)
    exact = np.maximum(_FULL_SPEED * shares_s / longest_s, 1e-6)
    # a motor with a rounded-up speed runs ahead and then waits for the end
    shares_s = longest_s * exact / np.ceil(exact - 1e-7)
    begin_s = np.zeros(6)
    if np.abs(travel[:4]).max() > STILL:
        begin_s[4:] = skew_s
    end_s = float(_trapezoid_s(np.array(longest_s), pace.ramp_s)) + max(0.0, skew_s)
    t_s = np.linspace(min(0.0, skew_s), end_s, steps_n)[:, None]
    done = _done(t_s - begin_s, shares_s, pace.ramp_s)
    slowest = int(np.argmax(exact))
    return q_from + (done * travel) @ _JOIN.T, done[:, slowest]


def _done(t_s: FloatArray, share_s: FloatArray, ramp_s: float) -> FloatArray:
    """Return which part of its way a motor has behind it after a time, by its trapezoid."""
    share_s = np.maximum(share_s, 1e-9)
    rise_s = np.minimum(ramp_s, np.sqrt(share_s * ramp_s))
    speed = rise_s / ramp_s
    all_s = share_s / speed + rise_s
    t_s = np.clip(t_s, 0.0, all_s)
    way = np.where(t_s < rise_s, t_s**2 / (2 * ramp_s), speed * (t_s - rise_s / 2))
    way = np.where(t_s > all_s - rise_s, share_s - (all_s - t_s) ** 2 / (2 * ramp_s), way)
    return np.asarray(way / share_s)


def leg_tube(
    layout: CellLayout, q_from: FloatArray, q_to: FloatArray, at: FloatArray
) -> FloatArray:
    """Return how far hand and part will be from where the joint line has them (k,) [mm].

    Parameters
    ----------
    q_from, q_to : (6,) ends of one move; at : (k,) shares of the line, 0 to 1
    """
    skew_s = layout.pace.skew_s
    courses = [leg_course(layout, q_from, q_to, _COURSE_N, s) for s in (-skew_s, skew_s)]
    q = np.concatenate([q for q, _ in courses])
    # the line's nearest point is a little before or behind that of the same instant
    share = np.clip(np.concatenate([d for _, d in courses])[:, None] + _BESIDE, 0.0, 1.0)
    line = _corners(layout, q_from + share[..., None] * (q_to - q_from))
    off = _corners(layout, q)[:, None] - line
    away = np.sqrt(np.einsum("nsij,nsij->nsi", off, off).max(axis=2))
    best = away.argmin(axis=1)
    every = np.arange(len(q))
    where = np.rint(share[every, best] * (_COURSE_N - 1)).astype(int)
    tube = np.zeros(_COURSE_N)
    for shift in (-1, 0, 1):  # between its points the course strays as far as at them
        np.maximum.at(tube, np.clip(where + shift, 0, _COURSE_N - 1), away[every, best])
    return np.asarray(np.interp(at, np.linspace(0.0, 1.0, _COURSE_N), tube))


def tube_bound_mm(layout: CellLayout, step: FloatArray, radii_mm: FloatArray) -> float:
    """Return more than `leg_tube` of a move by `step` (6,), at a fraction of its price.

    Parameters
    ----------
    radii_mm : (6,) by which a joint's change moves hand and part at most
    """
    travel = np.abs(motor_travel(step))
    shares_s = travel / _motor_speeds(layout.pace)
    longest_s = float(shares_s.max())
    if longest_s <= 0.0:
        return 0.0
    exact = np.maximum(_FULL_SPEED * shares_s / longest_s, 1e-6)
    ahead = (1.0 - exact / np.ceil(exact - 1e-7)) * travel
    if travel[:4].max() > STILL:
        ahead[4:] += travel[4:] * layout.pace.skew_s / max(longest_s, layout.pace.skew_s)
    return float(np.abs(_JOIN) @ ahead @ radii_mm)


def _corners(layout: CellLayout, q: FloatArray) -> FloatArray:
    """Return points (..., m, 3) that stand for hand and part: as far out as either."""
    T = tip_pose(layout, q)
    return np.asarray(T[..., None, :3, 3] + _OUT_MM @ np.swapaxes(T[..., :3, :3], -1, -2))
