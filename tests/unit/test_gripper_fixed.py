"""The pose of the fixed gripper from touches made up of a truth."""

from __future__ import annotations

from dataclasses import replace

import kinematic_cells as cells
import numpy as np
import pytest

from controller.commissioning.grippers import (
    Axis,
    Touch,
    TouchError,
    locate_fixed_gripper,
    plate_touch,
)
from controller.commissioning.kinematics import CellFit, calibrate_cell
from drivers.umi_scara.model import kinematics

# the shipped cell's: x along the world's y, y upwards
NOMINAL = cells.pose(np.column_stack([[0, 1, 0], [0, 0, 1], [1, 0, 0]]), [150.0, -330, 430])
STD = np.array([np.radians(1.0) / 5**0.5] * 3 + [4.0 / 5**0.5] * 3)
THICK_MM, PAD_X_MM, WIDTH_MM = 10.0, -12.0, 22.0


@pytest.fixture(scope="module")
def calibrated() -> tuple[cells.TrueCell, CellFit]:
    cell = cells.true_cell(81)
    return cell, calibrate_cell(cells.prior(), cells.pictures(cell, 14, 81))


def true_fixed(seed: int) -> np.ndarray:
    d = STD * np.random.default_rng(seed).standard_normal(6)
    return NOMINAL @ cells.pose(cells.turned(d[:3]), d[3:])


def joints(at: np.ndarray) -> np.ndarray:
    """Joints of the arm opposite the fixed gripper, its jaws' axis along the fixed one's."""
    x, y = -NOMINAL[:3, 0], NOMINAL[:3, 1]
    rows, legal = kinematics.inverse(cells.pose(np.column_stack([x, y, np.cross(x, y)]), at))
    out: np.ndarray = kinematics.counts_to_q(kinematics.q_to_counts(rows[legal][0]))
    return out


def on_plane(
    cell: cells.TrueCell,
    fixed: np.ndarray,
    q: np.ndarray,
    point: np.ndarray,
    along: int,
    axis: int,
    at_mm: float,
) -> np.ndarray:
    """A point of the arm's TCP frame, moved along one of its axes onto a plane, 0.05 mm off."""
    T = cell.T_world_tcp(q + cell.joint_std * cell.rng.standard_normal(6))
    n = fixed[:3, axis]
    gap = at_mm - n @ (T[:3, :3] @ point + T[:3, 3] - fixed[:3, 3])
    out = point.copy()
    out[along] += gap / (n @ T[:3, along]) + 0.05 * cell.rng.standard_normal()
    return out


def touches(cell: cells.TrueCell, fixed: np.ndarray, *, edges: bool) -> list[Touch]:
    out = []
    middle = np.array([150.0, -300, 430])
    for dx in (-30.0, 0.0, 30.0):
        for dy in (20.0, 50.0):
            for side in (-1, 1):
                q = joints(middle + np.array([dx, dy, -3.0 * side]))
                at = on_plane(
                    cell, fixed, q, np.array([PAD_X_MM, 0.0, 0.0]), 1, 1, side * THICK_MM / 2
                )
                opening = 2 * side * at[1]
                out.append(plate_touch(f"pad {len(out)}", q, opening, side, PAD_X_MM, THICK_MM))
    if edges:
        for dy in (15.0, 45.0):
            for side in (-1, 1):
                q = joints(middle + np.array([side * 40.0, dy, 0]))
                at = on_plane(cell, fixed, q, np.array([60.0, 0, 0]), 2, 2, side * WIDTH_MM / 2)
                out.append(Touch(f"side {len(out)}", q, at, Axis.Z, side * WIDTH_MM / 2))
        for dx in (-8.0, 8.0):
            q = joints(middle + np.array([dx, 60.0, 0]))
            at = on_plane(cell, fixed, q, np.array([100.0, 0, 0]), 0, 0, 0.0)
            out.append(Touch(f"tip {len(out)}", q, at, Axis.X, 0.0))
    return out


def off_by(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """How far a pose is off, in the true one's axes [mm], and its y axis's tilt [rad]."""
    d = np.linalg.inv(true) @ found
    return np.array([*d[:3, 3], np.arccos(np.clip(d[1, 1], -1, 1))])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_touches_on_the_plate_show_the_jaws_plane_and_no_more(
    calibrated: tuple[cells.TrueCell, CellFit], seed: int
) -> None:
    cell, fit = calibrated
    fixed = true_fixed(seed)
    found = locate_fixed_gripper(fit, NOMINAL, STD, touches(cell, fixed, edges=False))
    assert set(found.observed) == {"y_mm", "rx_rad", "rz_rad"}
    assert set(found.held) == {"x_mm", "z_mm", "ry_rad"}
    off = off_by(found.T_world_tcp, fixed)
    # a tilt moves the jaws' plane about where it was touched, some 40 mm away
    assert abs(off[1]) < 3.0 * np.sqrt(found.cov[4, 4])
    assert off[3] < 3.0 * np.hypot(*np.sqrt(np.diag(found.cov)[[0, 2]]))
    assert np.sqrt(found.cov[4, 4]) < 0.5


def test_touches_on_sides_and_tips_show_the_rest(
    calibrated: tuple[cells.TrueCell, CellFit],
) -> None:
    cell, fit = calibrated
    fixed = true_fixed(4)
    found = locate_fixed_gripper(fit, NOMINAL, STD, touches(cell, fixed, edges=True))
    # 30 mm along a finger are too short a lever for the angle about the jaws' axis
    assert set(found.observed) == {"x_mm", "y_mm", "z_mm", "rx_rad", "rz_rad"}
    assert np.linalg.norm(off_by(found.T_world_tcp, fixed)[:3]) < 2.5 * found.u_mm
    assert found.u_mm < 0.6
    assert 0.3 < found.rms_sigma < 1.5


def test_the_stated_uncertainty_is_that_of_many_truths(
    calibrated: tuple[cells.TrueCell, CellFit],
) -> None:
    cell, fit = calibrated
    exact = replace(fit, cov=np.zeros_like(fit.cov), x=fit.x)
    ratios = []
    for seed in range(100, 112):
        fixed = true_fixed(seed)
        found = locate_fixed_gripper(exact, NOMINAL, STD, touches(cell, fixed, edges=False))
        ratios.append(found.cov[4, 4])
    # the same touches are as certain wherever the gripper is, to first order
    assert max(ratios) < 1.5 * min(ratios)
    full = locate_fixed_gripper(fit, NOMINAL, STD, touches(cell, fixed, edges=False))
    assert full.cov[4, 4] > max(ratios)  # the arm's own uncertainty comes on top


def test_without_touches_the_drawing_stays(calibrated: tuple[cells.TrueCell, CellFit]) -> None:
    _, fit = calibrated
    found = locate_fixed_gripper(fit, NOMINAL, STD, [])
    np.testing.assert_allclose(found.T_world_tcp, NOMINAL)
    np.testing.assert_allclose(np.sqrt(np.diag(found.cov)), STD)
    assert found.observed == ()


def test_a_touch_of_something_else_is_named(calibrated: tuple[cells.TrueCell, CellFit]) -> None:
    cell, fit = calibrated
    made = touches(cell, true_fixed(5), edges=False)
    made[4] = replace(made[4], point_mm=made[4].point_mm + np.array([0, 4.0, 0]))
    with pytest.raises(TouchError, match="pad "):
        locate_fixed_gripper(fit, NOMINAL, STD, made)
