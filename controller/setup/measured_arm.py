"""A cell's arm as commissioning measures it, whatever its make: what its model says of itself."""

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.kinematics import ExactArm, KinematicArm
from controller.imaging import rotation_angle
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose

from .figures import MeasurableArm


def measured_arm(layout: CellLayout) -> KinematicArm:
    """Return what can be measured of a cell's arm; nothing of one whose model names no figures."""
    model = layout.arm
    return model.figures if isinstance(model, MeasurableArm) else ExactArm(model.forward)


def at_rest(layout: CellLayout, rows: FloatArray) -> tuple[float, float]:
    """Return the rms error of the TCP from where joints come to rest, in [mm] and [deg].

    Parameters
    ----------
    layout : layout of the cell
    rows : (n, 6) joints over which the mean is taken
    """
    T = tcp_pose(layout, rows)
    off_mm, off_deg = np.zeros(len(rows)), np.zeros(len(rows))
    for step in measured_arm(layout).rest_std:
        moved = tcp_pose(layout, rows + step)
        off_mm += np.sum((moved[:, :3, 3] - T[:, :3, 3]) ** 2, axis=1)
        pairs = zip(T[:, :3, :3], moved[:, :3, :3], strict=True)
        off_deg += np.degrees([rotation_angle(a.T @ b) for a, b in pairs]) ** 2
    return float(np.sqrt(off_mm.mean())), float(np.sqrt(off_deg.mean()))
