"""The UMI RTX as a chain; umi_rtx.md 6, read a second time.

A carriage slides along the column, two links turn on it, then a wrist whose three axes meet. The
joints are those of `emulators.umi_scara.ArmJoints`, in its order. Yaw turns the gripper about the
elbow's half: heading psi = shoulder + elbow / 2 + yaw, R = Rz(psi) Ry(-pitch) Rx(roll);
umi_rtx.md 6.4.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ..chain import TCP, Chain, Link
from ..shapes import Array, Box

JOINTS: Final = ("shoulder", "elbow", "yaw", "zed", "pitch", "roll")
_Z: Final = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class UmiShape:
    """Lengths and boxes of a UMI RTX.

    Attributes
    ----------
    upper_mm, fore_mm : shoulder to elbow, elbow to wrist
    tool_mm : wrist's centre to TCP
    wrist_height_mm : height of the wrist's axis with zed at the top
    carriage, upper, fore : boxes in the frames of these links
    tool_off_mm : offset of the TCP from the approach axis, along the jaws' axis and across
    """

    upper_mm: float
    fore_mm: float
    tool_mm: float
    wrist_height_mm: float
    carriage: Box
    upper: Box
    fore: Box
    tool_off_mm: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def chain(self) -> Chain:
        """The arm from its base, on the floor under the shoulder's axis."""
        links = (
            Link(
                "carriage", "", at(0.0, 0.0, self.wrist_height_mm), _Z,
                slides=True, drive={"zed": 1.0}, boxes=(self.carriage,), is_solid=False,
            ),
            Link(
                "upper", "carriage", at(0.0, 0.0, 0.0), _Z,
                drive={"shoulder": 1.0}, boxes=(self.upper,),
            ),
            Link(
                "fore", "upper", at(self.upper_mm, 0.0, 0.0), _Z,
                drive={"elbow": 1.0}, boxes=(self.fore,),
            ),
            # the forearm has turned by shoulder + elbow already
            Link(
                "heading", "fore", at(self.fore_mm, 0.0, 0.0), _Z,
                drive={"yaw": 1.0, "elbow": -0.5},
            ),
            Link("pitch", "heading", np.eye(4), (0.0, -1.0, 0.0), drive={"pitch": 1.0}),
            Link("roll", "pitch", np.eye(4), (1.0, 0.0, 0.0), drive={"roll": 1.0}),
            Link(TCP, "roll", at(self.tool_mm, *self.tool_off_mm)),
        )  # fmt: skip
        return Chain(JOINTS, links, MOTORS)


# How a motor's travel changes the joints; those of the wrist act together
MOTORS: Final = {
    "shoulder": {"shoulder": 1.0},
    "elbow": {"elbow": 1.0},
    "yaw": {"yaw": 1.0},
    "zed": {"zed": 1.0},
    "wrist1": {"pitch": 0.5, "roll": 0.5},
    "wrist2": {"pitch": 0.5, "roll": -0.5},
}


def at(x_mm: float, y_mm: float, z_mm: float) -> Array:
    """Return the pose (4, 4) of a frame that is moved and not turned.

    Parameters
    ----------
    x_mm, y_mm, z_mm : its origin
    """
    T = np.eye(4)
    T[:3, 3] = x_mm, y_mm, z_mm
    return T
