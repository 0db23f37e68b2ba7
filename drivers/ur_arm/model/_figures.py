"""The figures of one arm found by measuring it: how each link's frame differs from its drawing.

A link's frame is where its joint's axis is on the link before. The base joint has none: where its
axis is, is where the base is. Bounds are choices (ur.md 1.1): the maker's own corrections, which
the controller keeps, are not used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from .kinematics import MADE

if TYPE_CHECKING:
    from ._model import UrModel

__all__ = ["Figure", "UrFigures"]

Floats = NDArray[np.float64]

LINK_MM: Final = 0.4
LINK_RAD: Final = radians(0.06)
TOOL_MM: Final = 0.5
TOOL_RAD: Final = radians(0.1)
# standard deviation of a joint at rest: 0.03 mm of published repeatability at the reach of 850 mm
REST_RAD: Final = 0.03 / 850.0
_FREEDOMS: Final = ("rx_rad", "ry_rad", "rz_rad", "x_mm", "y_mm", "z_mm")


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure: its name, which ends in its unit, nominal value, and bound to either side."""

    name: str
    nominal: float
    bound: float


@dataclass(frozen=True, slots=True)
class UrFigures:
    """An arm with unknown errors, about a nominal one."""

    nominal: UrModel

    @property
    def unknowns(self) -> Sequence[Figure]:
        """The figures, in the order of ``values``: for each frame its turn, then its shift."""
        return tuple(
            Figure(f"{link}_{freedom}", float(self.nominal.made[row, column]), bound)
            for row, link in enumerate(MADE)
            for column, (freedom, bound) in enumerate(zip(_FREEDOMS, _bounds(link), strict=True))
        )

    @property
    def motors(self) -> Mapping[str, Floats]:
        """Nothing: its encoders are on the joints, behind the gears."""
        return {}

    @property
    def take_up(self) -> Floats:
        """No joint (6,) is turned back before a configuration: there is no play to be taken up."""
        return np.zeros(6)

    @property
    def joint_std(self) -> Floats:
        """Standard deviation (6,) of each joint at rest about its encoder [rad]."""
        return np.full(6, REST_RAD)

    @property
    def rest_std(self) -> Floats:
        """Each joint's standard deviation about where it is sent (6, 6): its repeatability."""
        return np.diag(self.joint_std)

    def tcp(self, q: Floats, values: Floats) -> Floats:
        """Return T_arm_tcp (n, 4, 4) of joints (n, 6), as the encoders have them, and values."""
        return self.nominal.measured(values).forward(q)

    def homes_from(self, q: Floats) -> NDArray[np.bool_]:
        """Return that the arm may home from any configuration (n, 6): no joint moves for it."""
        return np.ones(len(q), dtype=bool)


def _bounds(link: str) -> tuple[float, ...]:
    turn_rad, shift_mm = (TOOL_RAD, TOOL_MM) if link == MADE[-1] else (LINK_RAD, LINK_MM)
    return (*[turn_rad] * 3, *[shift_mm] * 3)
