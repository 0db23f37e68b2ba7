"""The arm's collisions: boxes and held parts against the cell, and the motors they stop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..layout import ArmLayout
from ..poses import Joints, JointValues, forward, invert
from ..shapes import Array, Box

BOX_MM: Final = 0.3  # boxes may overlap by this much: servo and rounding
PIECE_MM: Final = 1.5  # convex pieces are fatter than the part by about this
PUSH_MM: Final = 3.0  # a free part that cannot yield any more
_STEP: Final = 1e-4  # step for the velocity of a point by one motor [rad, mm]

Obstruct = Callable[[str, int, bool], None]


@dataclass(frozen=True, slots=True)
class Collision:
    """Something of the arm ran into something.

    Attributes
    ----------
    at_s : world time it began
    moving, other : names
    depth_mm : depth of the overlap when it was noticed
    """

    at_s: float
    moving: str
    other: str
    depth_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """An overlap of something that moves with a link; ``normal`` points out of the obstacle."""

    moving: str
    other: str
    frame: str
    depth_mm: float
    point_mm: Array
    normal: Array


class BoxSet:
    """Boxes in frames, and their bounds in the world."""

    def __init__(self, boxes: Sequence[Box]) -> None:
        lows = np.array([box.low_mm for box in boxes]).reshape(-1, 3)
        highs = np.array([box.high_mm for box in boxes]).reshape(-1, 3)
        ones = np.ones((len(boxes), 1))
        # columns, (n, 4, 1) and (n, 3, 1)
        self._centres = np.hstack([(lows + highs) / 2.0, ones])[..., None]
        self._halves = ((highs - lows) / 2.0)[..., None]

    def bounds(self, frames: Sequence[Array]) -> tuple[Array, Array]:
        """Return the bounds of the boxes in their frames, two (n, 3) [mm]."""
        T = np.array(frames)[:, :3]
        centres = (T @ self._centres)[..., 0]
        reach = (np.abs(T[:, :, :3]) @ self._halves)[..., 0]
        return centres - reach, centres + reach


def values_of(joints: Joints) -> JointValues:
    """Return a copy of joint values, which stays as it is while the arm goes on."""
    return JointValues(tuple(joints.q), joints.jaw_opening_mm)


class Stall:
    """Stops the motors that drive into something, and frees them when nothing overlaps."""

    def __init__(self, arm: ArmLayout, obstruct: Obstruct) -> None:
        self._arm = arm
        self._obstruct = obstruct
        self._blocked: set[tuple[str, int]] = set()

    @property
    def is_blocking(self) -> bool:
        """Whether some motor is stopped."""
        return bool(self._blocked)

    def apply(self, touches: Sequence[Touch], before: JointValues, now: JointValues) -> None:
        """Block the motors that have just moved into ``touches``; without any, free all.

        Parameters
        ----------
        touches : present overlaps of the arm, with the normal that points out of the obstacle
        before, now : joints before and after the step that led there
        """
        if not touches:
            for motor, direction in self._blocked:
                self._obstruct(motor, direction, False)
            self._blocked.clear()
            return
        chain = self._arm.chain
        moved = chain.motor_steps(np.subtract(now.q, before.q))
        here = forward(self._arm, now)
        for touch in touches:
            local = invert(here[touch.frame]) @ np.append(touch.point_mm, 1.0)
            for (motor, step), effect in zip(moved.items(), chain.effect.T, strict=True):
                if abs(step) < 1e-9:
                    continue
                direction = 1 if step > 0.0 else -1
                q = tuple(np.asarray(now.q) + _STEP * direction * effect)
                T = forward(self._arm, replace(now, q=q))[touch.frame]
                way = (T @ local)[:3] - touch.point_mm
                if way @ touch.normal < -0.05 * np.linalg.norm(way) - 1e-12:
                    self._obstruct(motor, direction, True)
                    self._blocked.add((motor, direction))
