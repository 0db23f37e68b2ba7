"""The duration of joint moves, and the arm's deviation from the joint line meanwhile.

A move is one command: target and speed per motor, the speeds such that all motors arrive together
(`synchronised_speeds` of `..motion`). Every motor then follows the same trapezoid, stretched; the
servo's lag is linear and the same for all, so that it keeps the arm on the line. Two things take
it off: speeds are whole numbers, rounded up, and the wrist's motors hang on another processor,
which starts a little earlier or later (umi_rtx.md 1.3, 2.5).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ._homing_sweep import SweepPhase

__all__ = ["STILL", "UmiTiming"]

Floats = NDArray[np.float64]

STILL: Final = 1e-6  # rad, mm: less than a count of any motor
# joints = these @ motors: pitch is half the sum, roll half the difference (umi_rtx.md 5.3)
_SPLIT: Final = np.eye(6)
_SPLIT[4:, 4:] = [[1.0, 1.0], [1.0, -1.0]]
_JOIN: Final[Floats] = np.asarray(np.linalg.inv(_SPLIT), np.float64)
_FULL_SPEED: Final = 100.0  # SPEED of the slowest motor; the others get a share, rounded up


@dataclass(frozen=True, slots=True)
class UmiTiming:
    """Speeds and fixed times of a move; the forecast is as good as these.

    They are fitted to the emulated arm over its wire, between what it takes in real time and ten
    times as fast (a study of 2026-11-22, kept in git history). A real arm wants timing once: no
    source vouches for umi_rtx.md 5.7.

    Attributes
    ----------
    joint_per_s : at full speed [rad/s, mm/s]; pitch and roll share their motors, so that their
        times add up
    ramp_s : from rest to full speed
    command_s : first request to the last read-back, once per move, but for what follows
    motor_s : target and speed written, place read back, per motor that moves
    switch_s : time to switch to the other processor, if a move needs wrist and other motors
    skew_s : largest delay of the wrist before or after the other motors
    """

    joint_per_s: tuple[float, ...] = (
        *np.radians([23.0, 44.0, 110.0]).tolist(),
        110.0,
        *np.radians([103.8, 103.8]).tolist(),
    )
    ramp_s: float = 0.25
    command_s: float = 0.10
    motor_s: float = 0.075
    switch_s: float = 0.04
    skew_s: float = 0.05

    @property
    def joint_speeds(self) -> Floats:
        """Full speed of each joint (6,) [rad/s, mm/s].

        Per motor as well: pitch alone runs both wrist motors at pitch's speed, and so does roll.
        """
        return np.asarray(self.joint_per_s, dtype=np.float64)

    def move_seconds(self, q_from: Floats, q_to: Floats) -> Floats:
        """Return the forecast of single moves between joints (..., 6): (...), 0 if none moves."""
        travel = np.abs(motor_travel(np.asarray(q_to) - np.asarray(q_from)))
        shares_s = travel / self.joint_speeds
        moved = travel > STILL
        motors = moved.sum(axis=-1)
        both = moved[..., :4].any(axis=-1) & moved[..., 4:].any(axis=-1)
        seconds = _trapezoid_s(shares_s.max(axis=-1), self.ramp_s)
        seconds = seconds + self.command_s + self.motor_s * motors + self.switch_s * both
        return np.asarray(np.where(motors > 0, seconds, 0.0))

    def travel_seconds(self, q_from: Floats, q_to: Floats) -> Floats:
        """Return the seconds of the slowest motor at full speed between joints (..., 6): (...)."""
        travel = np.abs(motor_travel(np.asarray(q_to) - np.asarray(q_from)))
        return np.asarray((travel / self.joint_speeds).max(axis=-1))

    def course(
        self, q_from: Floats, q_to: Floats, count: int, skew_s: float = 0.0
    ) -> tuple[Floats, Floats]:
        """Return the course of the joints over the time of one move.

        Parameters
        ----------
        q_from, q_to : (6,) ends of the move
        count : instants, evenly spaced
        skew_s : delay of the wrist against the other motors, or lead

        Returns
        -------
        q : (count, 6) joints
        share : (count,) of its way that the motor which needs longest has behind it
        """
        travel = motor_travel(q_to - q_from)
        shares_s = np.abs(travel) / self.joint_speeds
        longest_s = float(shares_s.max())
        if longest_s <= 0.0:
            return np.repeat(q_from[None], count, axis=0), np.linspace(0.0, 1.0, count)
        exact = np.maximum(_FULL_SPEED * shares_s / longest_s, 1e-6)
        # a motor with a rounded-up speed runs ahead and then waits for the end
        shares_s = longest_s * exact / np.ceil(exact - 1e-7)
        begin_s = np.zeros(6)
        if np.abs(travel[:4]).max() > STILL:
            begin_s[4:] = skew_s
        end_s = float(_trapezoid_s(np.array(longest_s), self.ramp_s)) + max(0.0, skew_s)
        t_s = np.linspace(min(0.0, skew_s), end_s, count)[:, None]
        done = _done(t_s - begin_s, shares_s, self.ramp_s)
        slowest = int(np.argmax(exact))
        return q_from + (done * travel) @ _JOIN.T, done[:, slowest]

    def courses(self, q_from: Floats, q_to: Floats, count: int) -> tuple[Floats, Floats]:
        """Return joints (m, 6) and shares (m,) of a move, the wrist at its earliest and latest.

        Parameters
        ----------
        q_from, q_to : (6,) ends of the move
        count : instants of either
        """
        both = [self.course(q_from, q_to, count, skew_s) for skew_s in (-self.skew_s, self.skew_s)]
        return np.concatenate([q for q, _ in both]), np.concatenate([share for _, share in both])

    def stray(self, step: Floats) -> Floats:
        """Return more than the joints (6,) are ever off the joint line in a move by `step` (6,)."""
        travel = np.abs(motor_travel(step))
        shares_s = travel / self.joint_speeds
        longest_s = float(shares_s.max())
        if longest_s <= 0.0:
            return np.zeros(6)
        exact = np.maximum(_FULL_SPEED * shares_s / longest_s, 1e-6)
        ahead = (1.0 - exact / np.ceil(exact - 1e-7)) * travel
        if travel[:4].max() > STILL:
            ahead[4:] += travel[4:] * self.skew_s / max(longest_s, self.skew_s)
        return np.asarray(np.abs(_JOIN) @ ahead)


def motor_travel(step: Floats) -> Floats:
    """Return the travel of the motors (..., 6) for changes of the joints (..., 6) [rad, mm]."""
    return np.asarray(np.asarray(step, np.float64) @ _SPLIT.T)


def move_sweep(q_from: Floats, q_to: Floats) -> SweepPhase:
    """Return the joints swept by one move if each motor is at a share of its own.

    Parameters
    ----------
    q_from, q_to : (6,) ends of the move
    """
    ends = motor_travel(np.stack([q_from, q_to]))
    return SweepPhase("the arm moves", ends.min(axis=0), ends.max(axis=0), _JOIN)


def _trapezoid_s(share_s: Floats, ramp_s: float) -> Floats:
    """Return the time for a way that takes `share_s` at full speed, starting and ending at rest."""
    peaked = 2.0 * np.sqrt(share_s * ramp_s)  # too short to reach full speed
    return np.where(share_s >= ramp_s, share_s + ramp_s, peaked)


def _done(t_s: Floats, share_s: Floats, ramp_s: float) -> Floats:
    """Return the share of its way that a motor has done after a time, by its trapezoid."""
    share_s = np.maximum(share_s, 1e-9)
    rise_s = np.minimum(ramp_s, np.sqrt(share_s * ramp_s))
    speed = rise_s / ramp_s
    all_s = share_s / speed + rise_s
    t_s = np.clip(t_s, 0.0, all_s)
    way = np.where(t_s < rise_s, t_s**2 / (2 * ramp_s), speed * (t_s - rise_s / 2))
    way = np.where(t_s > all_s - rise_s, share_s - (all_s - t_s) ** 2 / (2 * ramp_s), way)
    return np.asarray(way / share_s)
