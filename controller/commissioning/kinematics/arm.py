"""The arm as commissioning needs it: its TCP, and the errors it may have.

The arm's model is beside its driver and independent of this module: it matches by structure, as for
planning. Lengths are in mm, angles in rad; a name ends in its unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from controller.arrays import FloatArray


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

    def tcp(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Return T_arm_tcp (n, 4, 4).

        Parameters
        ----------
        q : (n, 6) joints, as the counters have them
        values : (k,) values of the unknowns
        """
