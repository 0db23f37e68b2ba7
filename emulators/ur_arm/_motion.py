"""Motion in joint space: a straight line with a trapezoid of speed, and a ramp down to rest.

All joints arrive together. Time is handed in; universal_robots.md 5.2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ._facts import Joints6

LARGEST_ACCELERATION_RAD_PER_S2: Final = 40.0  # what the arm's motors can do at most; typical


@dataclass(frozen=True, slots=True)
class Sample:
    """Set-points of the joints at one instant [rad, rad/s, rad/s^2]."""

    q: Joints6
    qd: Joints6
    qdd: Joints6


def _six(values: Sequence[float]) -> Joints6:
    one, two, three, four, five, six = values
    return one, two, three, four, five, six


ZERO: Joints6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class JointMove:
    """A straight line in joint space, from rest to rest.

    Speed and acceleration are those of the joint with the longest way; the others keep in step. No
    joint is faster than its limit.

    Parameters
    ----------
    start, goal : (6,) [rad]
    speed_rad_per_s, acceleration_rad_per_s2 : of the leading joint
    limits_rad_per_s : (6,) largest speeds
    duration_s : 0, or the time that the move is to take in place of speed and acceleration; one
        that the limits do not allow is exceeded

    Attributes
    ----------
    start, goal : as given
    duration_s : of the whole move [path s]
    ramp_s : of each of its ramps [path s]
    """

    def __init__(
        self,
        start: Joints6,
        goal: Joints6,
        speed_rad_per_s: float,
        acceleration_rad_per_s2: float,
        limits_rad_per_s: Sequence[float],
        duration_s: float = 0.0,
    ) -> None:
        self.start, self.goal = start, goal
        ways = [b - a for a, b in zip(start, goal, strict=True)]
        self._way = max(abs(way) for way in ways)
        self.duration_s = self.ramp_s = 0.0
        if self._way == 0.0:
            return
        self._share = _six([way / self._way for way in ways])
        fastest = min(
            limit / abs(share)
            for limit, share in zip(limits_rad_per_s, self._share, strict=True)
            if share
        )
        if duration_s > 0.0:
            speed, acceleration = self._by_time(duration_s, fastest)
        else:
            speed, acceleration = min(speed_rad_per_s, fastest), acceleration_rad_per_s2
        self._acceleration = acceleration
        self._speed = min(speed, math.sqrt(self._way * acceleration))
        self.ramp_s = self._speed / acceleration
        self._cruise_s = self._way / self._speed - self.ramp_s
        self.duration_s = 2.0 * self.ramp_s + self._cruise_s

    def _by_time(self, duration_s: float, fastest: float) -> tuple[float, float]:
        """Return speed and acceleration of a move whose ramps take a quarter of its time each."""
        speed = min(self._way / (0.75 * duration_s), fastest)
        return speed, min(4.0 * speed / duration_s, LARGEST_ACCELERATION_RAD_PER_S2)

    def at(self, path_s: float) -> Sample:
        """Return the set-points at a time on the path, which a speed slider stretches [path s]."""
        if path_s >= self.duration_s:
            return Sample(self.goal, ZERO, ZERO)
        a, ramp_s = self._acceleration, self.ramp_s
        left_s = self.duration_s - path_s
        if path_s < ramp_s:
            way, speed, acceleration = a * path_s**2 / 2.0, a * path_s, a
        elif left_s < ramp_s:
            way, speed, acceleration = self._way - a * left_s**2 / 2.0, a * left_s, -a
        else:
            way = self._speed * (path_s - ramp_s / 2.0)
            speed, acceleration = self._speed, 0.0
        share = self._share
        return Sample(
            _six([q + way * one for q, one in zip(self.start, share, strict=True)]),
            _six([speed * one for one in share]),
            _six([acceleration * one for one in share]),
        )


class Ramp:
    """The end of a motion: all joints come to rest together, along the line they are on.

    Parameters
    ----------
    start : where they are and how fast
    deceleration_rad_per_s2 : of the fastest joint
    """

    def __init__(self, start: Sample, deceleration_rad_per_s2: float) -> None:
        self._start = start
        fastest = max(abs(speed) for speed in start.qd)
        self.duration_s = fastest / deceleration_rad_per_s2

    def at(self, time_s: float) -> Sample:
        """Return the set-points a time after the ramp began [s]."""
        if self.duration_s == 0.0:
            return Sample(self._start.q, ZERO, ZERO)
        t = min(time_s, self.duration_s)
        left = 1.0 - t / self.duration_s
        gone_s = t * (1.0 + left) / 2.0
        is_over = time_s >= self.duration_s
        q, qd = self._start.q, self._start.qd
        return Sample(
            _six([at + speed * gone_s for at, speed in zip(q, qd, strict=True)]),
            ZERO if is_over else _six([speed * left for speed in qd]),
            ZERO if is_over else _six([-speed / self.duration_s for speed in qd]),
        )


class Trajectory:
    """Set-points over time: a move, two that blend into each other, or a ramp down to rest.

    Parameters
    ----------
    q_rad : (6,) where the joints begin, at rest

    Attributes
    ----------
    target : present set-points
    """

    def __init__(self, q_rad: Joints6) -> None:
        self.rest_at(q_rad)

    def rest_at(self, q_rad: Joints6) -> None:
        """Be at rest there at once."""
        self.target = Sample(q_rad, ZERO, ZERO)
        self._ramp: Ramp | None = None
        self._ramp_s = 0.0
        self._moves: list[tuple[JointMove, float]] = []  # each with its time on the path

    @property
    def is_ramping(self) -> bool:
        """Whether a ramp down to rest is under way."""
        return self._ramp is not None

    @property
    def is_moving(self) -> bool:
        """Whether a move is under way."""
        return bool(self._moves)

    @property
    def goal(self) -> Joints6:
        """Where the last move ends; without one, the present set-points."""
        return self._moves[-1][0].goal if self._moves else self.target.q

    def begin(self, move: JointMove) -> None:
        """Begin a move, over the end of the present one if there is one."""
        self._moves.append((move, 0.0))

    def may_blend_into(self, move: JointMove) -> bool:
        """Return whether a move may begin now, over the end of the only one.

        That is so once the arm slows down for the present goal and will be there before the other
        move has reached its full speed: no joint is then faster than in one of them.
        """
        if len(self._moves) != 1:
            return False
        present, path_s = self._moves[0]
        left_s = present.duration_s - path_s
        return left_s <= min(present.ramp_s, move.ramp_s)

    def slow_down(self, deceleration_rad_per_s2: float) -> None:
        """Give up all moves and come to rest."""
        self._moves = []
        if any(self.target.qd):
            self._ramp, self._ramp_s = Ramp(self.target, deceleration_rad_per_s2), 0.0

    def step(self, dt_s: float, scaling: float) -> Sample:
        """Let time pass and return the set-points; `target` is left to the caller.

        Parameters
        ----------
        dt_s : time [world s]
        scaling : factor of all speeds on a path; ramps know none
        """
        if self._ramp is not None:
            self._ramp_s += dt_s
            sample = self._ramp.at(self._ramp_s)
            if self._ramp_s >= self._ramp.duration_s:
                self._ramp = None
            return sample
        self._moves = [(move, path_s + dt_s * scaling) for move, path_s in self._moves]
        samples = [(move.at(path_s), move.start) for move, path_s in self._moves]
        (first, _), others = samples[0], samples[1:]
        q, qd, qdd = first.q, first.qd, first.qdd
        for one, start in others:
            ways = [at - begun for at, begun in zip(one.q, start, strict=True)]
            q, qd, qdd = _sum(q, ways), _sum(qd, one.qd), _sum(qdd, one.qdd)
        self._moves = [(move, at_s) for move, at_s in self._moves if at_s < move.duration_s]
        if scaling != 1.0:
            qd = _six([speed * scaling for speed in qd])
            qdd = _six([acceleration * scaling**2 for acceleration in qdd])
        return Sample(q, qd, qdd)


def _sum(one: Sequence[float], other: Sequence[float]) -> Joints6:
    return _six([a + b for a, b in zip(one, other, strict=True)])
