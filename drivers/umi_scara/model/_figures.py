"""The figures of one arm found by measuring it, as a vector.

The unknowns of a calibration: lengths, tool, the zero of each joint's counter, and the dependence
of heading and height on the elbow. Bounds are those of an arm that was set up with care (umi_rtx.md
4.2 has the factory values of the zeros, 6.1 the nominal lengths).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from . import kinematics
from .kinematics import ArmGeometry

Floats = NDArray[np.float64]

LINK_MM: Final = 0.3
TOOL_MM: Final = 0.5
ZERO_RAD: Final = radians(0.5)
# a joint stands half the play of its gear under the counter if its motor came from below
PLAY_RAD: Final = radians(0.15)
ZED_ZERO_MM: Final = 0.5
YAW_PER_ELBOW: Final = 0.005
SAG_MM: Final = 0.8
_ZEROS: Final = ("shoulder_rad", "elbow_rad", "yaw_rad", "pitch_rad", "roll_rad")


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure: its name, which ends in its unit, nominal value, and bound to either side."""

    name: str
    nominal: float
    bound: float


@dataclass(frozen=True, slots=True)
class UmiFigures:
    """An arm with unknown errors, about a nominal one."""

    nominal: ArmGeometry

    @property
    def unknowns(self) -> Sequence[Figure]:
        """The figures, in the order of ``values``."""
        arm = self.nominal
        zeros = zip(_ZEROS, arm.zero_rad, strict=True)
        return (
            Figure("upper_mm", arm.upper_mm, LINK_MM),
            Figure("fore_mm", arm.fore_mm, LINK_MM),
            Figure("tool_mm", arm.tool_mm, TOOL_MM),
            Figure("tool_off_y_mm", arm.tool_off_mm[0], TOOL_MM),
            Figure("tool_off_z_mm", arm.tool_off_mm[1], TOOL_MM),
            *(Figure(name, zero, ZERO_RAD + PLAY_RAD) for name, zero in zeros),
            Figure("zed_zero_mm", arm.zed_zero_mm, ZED_ZERO_MM),
            Figure("yaw_per_elbow", arm.yaw_per_elbow, YAW_PER_ELBOW),
            Figure("sag_mm", arm.sag_mm, SAG_MM),
        )

    @property
    def motors(self) -> Mapping[str, Floats]:
        """The joints' (6,) turn with each geared motor, per radian of its own scale.

        Both wrist motors turn pitch and roll, half as far as they turn themselves (umi_rtx.md 5.3).
        """
        turns = {
            "elbow": (0.0, 1.0, 0.0, 0.0, 0.0, 0.0),
            "shoulder": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            "yaw": (0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            "wrist1": (0.0, 0.0, 0.0, 0.0, 0.5, 0.5),
            "wrist2": (0.0, 0.0, 0.0, 0.0, 0.5, -0.5),
        }
        return {name: np.array(joints) for name, joints in turns.items()}

    def geometry(self, values: Floats) -> ArmGeometry:
        """Return the arm of values (13,)."""
        upper, fore, tool, off_y, off_z, *zeros = (float(v) for v in values[:10])
        shoulder, elbow, yaw, pitch, roll = zeros
        zed_zero, coupling, sag = (float(v) for v in values[10:])
        return replace(
            self.nominal,
            upper_mm=upper,
            fore_mm=fore,
            tool_mm=tool,
            tool_off_mm=(off_y, off_z),
            zero_rad=(shoulder, elbow, yaw, pitch, roll),
            zed_zero_mm=zed_zero,
            yaw_per_elbow=coupling,
            sag_mm=sag,
        )

    def tcp(self, q: Floats, values: Floats) -> Floats:
        """Return T_arm_tcp (n, 4, 4) of joints (n, 6), as the counters have them, and values."""
        return kinematics.forward(q, self.geometry(values))
