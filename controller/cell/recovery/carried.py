"""The parts in the grippers while the arm moves, for a proof that it touches nothing."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.arrays import FloatArray

from ..custody import ALONE, Around, Custody
from .interrupted import Interrupted


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Carried:
    """The openings of both grippers, and the part in one of them.

    Attributes
    ----------
    arm_opening_mm : opening of the arm gripper; None if it is empty, however wide
    T_part_tcp : (4, 4) pose of a part in the arm gripper, or None
    fixed_opening_mm : opening of the fixed gripper
    T_part_fixed : (4, 4) pose of a part in the fixed gripper, T_part_tcp of that one, or None
    around : other objects in the cell
    """

    arm_opening_mm: float | None
    T_part_tcp: FloatArray | None
    fixed_opening_mm: float
    T_part_fixed: FloatArray | None
    around: Around = ALONE

    @property
    def carried(self) -> tuple[Any, ...]:
        """The last arguments of `homing_swept` and `proven_back` of the compute service."""
        return (
            self.arm_opening_mm,
            self.T_part_tcp,
            self.fixed_opening_mm,
            self.T_part_fixed,
            self.around,
        )


def part_in_gripper(
    left: Interrupted, custody: Custody
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return T_part_tcp (4, 4) of the part in the arm gripper, and in the fixed one; else None.

    Parameters
    ----------
    left : state of the grippers with the part
    custody : gripper with the part
    """
    in_arm = left.arm_hold if custody is Custody.IN_ARM else None
    in_fixed = left.fixed_hold if custody is Custody.IN_FIXED else None
    return (
        None if in_arm is None else np.array(in_arm.T_part_tcp),
        None if in_fixed is None else np.array(in_fixed.T_part_tcp),
    )
