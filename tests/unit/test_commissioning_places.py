"""Where trays and table are by touches: middles, sizes, planes, and what gears leave open."""

from pathlib import Path

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.bring_up.steps.trays import obstacle_words
from controller.calibration.places import (
    CornerTouch,
    aim_uncertainty,
    fit_plane,
    locate_tray,
    play_uncertainty_mm,
)
from controller.calibration.reach import rows_down, shifted
from controller.config import Cell, load_yaml
from controller.planning.motion import tcp_pose
from controller.setup.layout import build_layout
from controller.setup.measured_arm import measured_arm

SIZE = (150.0, 140.0)
CELLS = Path(__file__).parents[2] / "recipes" / "cells"
CELL = load_yaml(CELLS / "emulated.yaml", Cell)


def touched(corner: tuple[int, int], x: float, y: float, z: float = 0.0) -> CornerTouch:
    return CornerTouch(corner, np.array([x, y, z]))


def test_a_tray_is_half_its_size_from_a_corner() -> None:
    fit = locate_tray(SIZE, [touched((1, -1), 178.0, 312.0, 0.3)])
    np.testing.assert_allclose(fit.centre_mm, [103.0, 382.0])
    assert fit.off_mm == 0.0
    assert fit.height_mm == pytest.approx(0.3)


def test_two_opposite_corners_give_the_middle_of_a_turned_tray() -> None:
    c, s = np.cos(0.01), np.sin(0.01)
    half = np.array([[c, -s], [s, c]]) @ (75.0, -70.0)
    middle = np.array([100.0, 390.0])
    fit = locate_tray(
        SIZE, [touched((1, -1), *(middle + half)), touched((-1, 1), *(middle - half))]
    )
    np.testing.assert_allclose(fit.centre_mm, middle)
    # turned by 10 mrad, a corner at 103 mm from the middle is a millimetre off
    assert fit.off_mm == pytest.approx(np.hypot(75, 70) * 0.01, rel=0.01)


def test_a_tray_of_another_size_shows() -> None:
    fit = locate_tray(SIZE, [touched((1, -1), 180.0, 320.0), touched((-1, -1), 20.0, 320.0)])
    assert fit.off_mm == pytest.approx(5.0)  # 160 mm wide instead of 150


def test_without_a_touch_there_is_no_tray() -> None:
    with pytest.raises(ValueError, match="no corner was touched"):
        locate_tray(SIZE, [])


def test_a_plane_has_its_tilt_and_height() -> None:
    x, y = np.meshgrid([280.0, 440.0], [-90.0, 90.0])
    x, y = x.ravel(), y.ravel()
    plane = fit_plane(np.stack([x, y, 0.4 + 0.002 * (x - 360.0) - 0.001 * y], axis=1))
    assert plane.height_mm == pytest.approx(0.4)
    assert plane.tilt_deg == pytest.approx(np.degrees(np.hypot(0.002, 0.001)), rel=1e-4)
    assert plane.rms_mm == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("points", [[(0, 0, 0), (1, 0, 0)], [(0, 0, 0), (1, 1, 0), (2, 2, 1)]])
def test_what_spans_no_plane_is_refused(points: list[tuple[float, ...]]) -> None:
    with pytest.raises(ValueError, match="three points that are not on a line"):
        fit_plane(np.array(points, dtype=float))


def test_play_of_the_shoulder_moves_the_tips_by_their_distance_from_it() -> None:
    layout = emulated_layout()
    # stretched ahead, the gripper level: 253.5 + 253.5 + 177 mm
    motors = measured_arm(layout).motors
    found = play_uncertainty_mm(layout, np.zeros(6), {"shoulder": 0.3}, motors)
    assert found == pytest.approx(684.0 * np.radians(0.3) / np.sqrt(12), rel=1e-3)
    assert play_uncertainty_mm(layout, np.zeros(6), {}, motors) == 0.0
    assert play_uncertainty_mm(layout, np.zeros(6), {"shoulder": 0.3}, {}) == 0.0


@pytest.mark.parametrize("name", ["emulated", "ur5e"])
def test_a_tcp_that_is_shifted_keeps_its_direction(name: str) -> None:
    layout = build_layout(load_yaml(CELLS / f"{name}.yaml", Cell))
    down = rows_down(layout, np.array([330.0, 40.0, 60.0]))
    assert len(down)
    lower = shifted(layout, down, np.array([0.0, 0.0, -30.0]))
    T = tcp_pose(layout, lower)
    np.testing.assert_allclose(T[:, :3, 3], np.tile([330.0, 40.0, 30.0], (len(down), 1)), atol=0.01)
    np.testing.assert_allclose(T[:, :3, :3], tcp_pose(layout, down)[:, :3, :3], atol=1e-4)


def test_a_tcp_is_not_shifted_out_of_reach() -> None:
    layout = build_layout(load_yaml(CELLS / "ur5e.yaml", Cell))
    down = rows_down(layout, np.array([330.0, 40.0, 60.0]))[:1]
    assert np.isnan(shifted(layout, down, np.array([2000.0, 0.0, 0.0]))).all()


def test_more_touches_leave_less_of_a_hand_open() -> None:
    # half the radius that holds 95 % of a two-dimensional normal distribution: 2.4477 / 2
    assert aim_uncertainty(0.3, 1) == pytest.approx(0.3 * 2.4477 / 2, rel=1e-3)
    assert aim_uncertainty(0.3, 4) == pytest.approx(aim_uncertainty(0.3, 1) / 2)


def test_a_person_is_shown_everything_that_paths_keep_clear_of() -> None:
    words = "; ".join(obstacle_words(CELL))
    for name in ("post of the fixed gripper", *CELL.obstacles, *CELL.chute.walls):  # type: ignore[union-attr]
        assert name.replace("_", " ") in words
    assert "inspection camera x 390 to 470, y -820 to -690, z 400 to 500 mm" in words
