"""An arm with six revolute joints as a driver offers it: how it is built, but no wire to one.

For plans and `cellctl check`. `six_axis_arm` has its kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from six_axis_arm import SixAxis

from drivers.errors import LinkError
from drivers.kinds import Arm, ArmDescription, ArmDriver, NoSettings, Site


@dataclass(frozen=True, slots=True)
class Shape:
    """What the cell file says under ``arm.shape:``."""

    upper_mm: float
    fore_mm: float
    tool_mm: float
    park_deg: tuple[float, float, float, float, float, float]
    height_mm: float = 430.0
    ahead_mm: float = 60.0

    def __post_init__(self) -> None:
        if min(self.upper_mm, self.fore_mm) < 2.0 * self.ahead_mm:
            raise ValueError("upper arm and forearm are longer than twice ahead_mm")


def describe(shape: Shape) -> ArmDescription[SixAxis]:
    """Return the arm with these lengths."""
    arm = SixAxis(shape.height_mm, shape.ahead_mm, shape.upper_mm, shape.fore_mm, shape.tool_mm)
    return ArmDescription(arm, np.radians(shape.park_deg))


def build(site: Site, settings: NoSettings) -> Arm:
    raise LinkError(f"{site.name}: this package plans for the arm and has no wire to it")


DRIVER: ArmDriver[NoSettings, Shape, SixAxis] = ArmDriver(NoSettings, build, Shape, describe)
