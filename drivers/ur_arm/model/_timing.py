"""The duration of joint moves (``movej``), and the arm's course during them.

All joints start and stop together on the joint line; speed `v` and acceleration `a` of the command
are the leading axis', the one that turns farthest (§4.1). The driver sends, for each move, the
speed at which no joint passes its own limit.

Sections (§) are those of ur.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["STILL_RAD", "UrTiming"]

Floats = NDArray[np.float64]

STILL_RAD = 1e-6  # below the encoders' resolution


@dataclass(frozen=True, slots=True)
class UrTiming:
    """Speeds of a move; the forecast is as good as these.

    Attributes
    ----------
    joint_rad_s : speed of each joint in a move, none above its published limit [rad/s]
    acceleration_rad_s2 : of the leading axis [rad/s²]
    command_s : script sent to the first motion, and the last motion to the end that is proven: 0.04
        s over the wire to the emulated controller
    """

    joint_rad_s: tuple[float, float, float, float, float, float]
    acceleration_rad_s2: float
    command_s: float = 0.05

    @property
    def joint_speeds(self) -> Floats:
        """Full speed of each joint (6,) [rad/s]."""
        return np.asarray(self.joint_rad_s, np.float64)

    def leading_speed(self, step: Floats, share: float = 1.0) -> float:
        """Return the speed `v` of the command of a move by `step` (6,) [rad/s].

        Parameters
        ----------
        step : change of the joints [rad]
        share : share of the usual speed, above 0 to 1
        """
        far = np.abs(np.asarray(step, np.float64))
        slowest_s = float((far / self.joint_speeds).max())
        return share * float(far.max()) / slowest_s if slowest_s > 0.0 else share

    def move_seconds(self, q_from: Floats, q_to: Floats, share: float = 1.0) -> Floats:
        """Return the forecast of single moves between (..., 6): (...), 0 where nothing moves.

        Parameters
        ----------
        q_from, q_to : joints
        share : share of the usual speed, above 0 to 1
        """
        far = np.abs(np.asarray(q_to, np.float64) - q_from)
        lead = far.max(axis=-1)
        flat_s = (far / self.joint_speeds).max(axis=-1) / share
        moves = lead > STILL_RAD
        ramp_s = np.where(moves, lead / np.where(moves, flat_s, 1.0), 0.0)
        ramp_s = ramp_s / self.acceleration_rad_s2
        short_s = 2.0 * np.sqrt(lead / self.acceleration_rad_s2)
        seconds = np.where(flat_s >= ramp_s, flat_s + ramp_s, short_s)
        return np.asarray(np.where(moves, seconds + self.command_s, 0.0))

    def travel_seconds(self, q_from: Floats, q_to: Floats) -> Floats:
        """Return the seconds of the slowest joint at full speed between (..., 6): (...)."""
        far = np.abs(np.asarray(q_to, np.float64) - q_from)
        return np.asarray((far / self.joint_speeds).max(axis=-1))

    def courses(self, q_from: Floats, q_to: Floats, count: int) -> tuple[Floats, Floats]:
        """Return the course over time in one move: joints (count, 6), share done (count,).

        Parameters
        ----------
        q_from, q_to : (6,) ends of the move
        count : instants, evenly spaced
        """
        step = np.asarray(q_to, np.float64) - q_from
        lead = float(np.abs(step).max())
        if lead <= STILL_RAD:
            return np.repeat(np.asarray(q_from)[None], count, axis=0), np.linspace(0, 1, count)
        accel = self.acceleration_rad_s2
        speed = min(self.leading_speed(step), float(np.sqrt(lead * accel)))
        ramp_s, all_s = speed / accel, lead / speed + speed / accel
        t_s = np.linspace(0.0, all_s, count)
        way = np.where(t_s < ramp_s, accel * t_s**2 / 2, speed * (t_s - ramp_s / 2))
        way = np.where(t_s > all_s - ramp_s, lead - accel * (all_s - t_s) ** 2 / 2, way)
        share = way / lead
        return np.asarray(q_from) + share[:, None] * step, share

    def stray(self, step: Floats) -> Floats:
        """Return 0 for each joint: the controller leads all of them along the joint line."""
        return np.zeros_like(step)
