"""The arm as commissioning needs it: its TCP, the errors it may have, and how it comes to rest.

The arm's model is beside its driver and independent of this module: it matches by structure, as for
planning. Lengths are in mm, angles in rad; a name ends in its unit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import radians
from typing import Final, Protocol

import numpy as np

from controller.arrays import BoolArray, FloatArray

# standard deviation of a joint at rest of which nothing is known; the pictures find the true one as
# a multiple of it
REST_RAD: Final = radians(0.01)


class ArmUnknown(Protocol):
    """One figure of an arm that no drawing gives well enough."""

    @property
    def name(self) -> str:
        """Name of the figure, such as `upper_mm` or `elbow_rad`; it ends in the unit."""

    @property
    def nominal(self) -> float:
        """The drawing's value."""

    @property
    def bound(self) -> float:
        """Largest error, in either direction."""


class KinematicArm(Protocol):
    """An arm with unknown errors."""

    @property
    def unknowns(self) -> Sequence[ArmUnknown]:
        """Its figures, in the order of `values`."""

    @property
    def motors(self) -> Mapping[str, FloatArray]:
        """Turn of the joints (6,) with each motor whose gears have play, per rad of its scale."""

    @property
    def take_up(self) -> FloatArray:
        """How far the joints (6,) are turned back before a configuration, to take up all play."""

    @property
    def joint_std(self) -> FloatArray:
        """Standard deviation (6,) of each joint at rest about its counter [rad, mm]."""

    @property
    def rest_std(self) -> FloatArray:
        """Where the joints come to rest about where they are sent, (k, 6) [rad, mm].

        Independent causes, each as the joints' change by one standard deviation of it: rounding to
        counts, published repeatability.
        """

    def tcp(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Return T_arm_tcp (n, 4, 4).

        Parameters
        ----------
        q : (n, 6) joints, as the counters have them
        values : (k,) values of the unknowns
        """

    def homes_from(self, q: FloatArray) -> BoolArray:
        """Return from which configurations (n, 6) the arm may home, by a mask (n,)."""


@dataclass(frozen=True, slots=True, eq=False)
class ExactArm:
    """An arm whose model names no figures: it is taken to be as drawn, from its base to its TCP.

    Attributes
    ----------
    forward : returns T_arm_tcp (n, 4, 4) of joints (n, 6)
    """

    forward: Callable[[FloatArray], FloatArray]

    @property
    def unknowns(self) -> Sequence[ArmUnknown]:
        """None."""
        return ()

    @property
    def motors(self) -> Mapping[str, FloatArray]:
        """None that is known."""
        return {}

    @property
    def take_up(self) -> FloatArray:
        """No joint (6,) is turned back."""
        return np.zeros(6)

    @property
    def joint_std(self) -> FloatArray:
        """Standard deviation (6,) of each joint at rest [rad]."""
        return np.full(6, REST_RAD)

    @property
    def rest_std(self) -> FloatArray:
        """Each joint by itself (6, 6)."""
        return np.diag(self.joint_std)

    def tcp(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Return T_arm_tcp (n, 4, 4).

        Parameters
        ----------
        q : (n, 6) joints
        values : (0,)
        """
        return self.forward(q)

    def homes_from(self, q: FloatArray) -> BoolArray:
        """Return that it may home from anywhere (n,)."""
        return np.ones(len(q), dtype=bool)
