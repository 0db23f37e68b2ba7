"""A UMI RTX as commissioning measures it: its figures, its motors, and the calibration of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import rotation_angle
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from drivers.umi_scara import UmiFigures, UmiModel, kinematics


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredArm:
    """Figures of an arm that can be measured.

    Attributes
    ----------
    figures : its figures about the drawing's
    """

    figures: UmiFigures

    @property
    def motors(self) -> Mapping[str, FloatArray]:
        """Turn of the joints (6,) with each motor whose gears have play, per rad of it."""
        return self.figures.motors

    def fields(self, found: Mapping[str, float]) -> dict[str, Any]:
        """Return the fields of an `ArmCalibration` that figures by name fill."""
        values = np.array([found[one.name] for one in self.figures.unknowns])
        arm = self.figures.geometry(values)
        names = ("shoulder", "elbow", "yaw", "pitch", "roll")
        return {
            "upper_mm": arm.upper_mm,
            "fore_mm": arm.fore_mm,
            "tool_mm": arm.tool_mm,
            "tool_off_mm": arm.tool_off_mm,
            "zero_deg": dict(zip(names, map(degrees, arm.zero_rad), strict=True)),
            "zed_zero_mm": arm.zed_zero_mm,
            "yaw_per_elbow": arm.yaw_per_elbow,
            "sag_mm": arm.sag_mm,
        }


def measured_arm(layout: CellLayout) -> MeasuredArm | None:
    """Return the figures of a cell's arm that can be measured; None unless it is a UMI RTX."""
    model = layout.arm
    return MeasuredArm(UmiFigures(model.geometry)) if isinstance(model, UmiModel) else None


def rounding(layout: CellLayout, rows: FloatArray) -> tuple[float, float]:
    """Return the rms error of the TCP from rounding to whole motor counts, in [mm] and [deg].

    Parameters
    ----------
    layout : layout of a cell with a UMI RTX
    rows : (n, 6) joints over which the mean is taken
    """
    # each motor's count turns its joints by so much; rounding is even within half a count
    by_count = kinematics.counts_to_q(np.eye(6)) / np.sqrt(12.0)
    T = tcp_pose(layout, rows)
    off_mm, off_deg = np.zeros(len(rows)), np.zeros(len(rows))
    for step in by_count:
        moved = tcp_pose(layout, rows + step)
        off_mm += np.sum((moved[:, :3, 3] - T[:, :3, 3]) ** 2, axis=1)
        pairs = zip(T[:, :3, :3], moved[:, :3, :3], strict=True)
        off_deg += np.degrees([rotation_angle(a.T @ b) for a, b in pairs]) ** 2
    return float(np.sqrt(off_mm.mean())), float(np.sqrt(off_deg.mean()))
