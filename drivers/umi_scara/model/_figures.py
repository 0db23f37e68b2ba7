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
# standard deviation of a joint at rest, by chance: rounding to a count and the dead band of its
# servo
JOINT_STD: Final = np.array(
    [radians(0.02), radians(0.04), radians(0.06), 0.15, radians(0.04), radians(0.04)]
)
# Larger than the play of any sound gear, and than the rounding to a count. Shoulder, elbow, yaw and
# pitch are turned back; with pitch alone both motors of the wrist are.
TAKE_UP: Final = np.array([1.0, 1.0, 1.0, 0.0, 1.0, 0.0]) * radians(1.5)
# Homing folds the elbow by 30 degrees more, then turns the shoulder to its stop (umi_rtx.md 4.1).
# From farther on the palm meets the column, and where that is passes for the stop.
FOLDED_RAD: Final = radians(92.0)
_ELBOW: Final = kinematics.Q_ORDER.index("elbow_rad")
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

    @property
    def take_up(self) -> Floats:
        """How far the joints (6,) are turned back before a configuration, to take up all play."""
        return TAKE_UP.copy()

    @property
    def joint_std(self) -> Floats:
        """Standard deviation (6,) of each joint at rest about its counter [rad, mm]."""
        return JOINT_STD.copy()

    @property
    def rest_std(self) -> Floats:
        """The joints' change (6, 6) by each motor's rounding to whole counts."""
        # rounding is even within half a count
        return np.asarray(kinematics.counts_to_q(np.eye(6)) / np.sqrt(12.0))

    def homes_from(self, q: Floats) -> NDArray[np.bool_]:
        """Return from which configurations (n, 6) the arm may home, by a mask (n,)."""
        return np.asarray(np.abs(np.asarray(q)[:, _ELBOW]) <= FOLDED_RAD)

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
