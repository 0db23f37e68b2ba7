"""The board at its mark, seen twice: a camera that was moved meanwhile is named."""

from dataclasses import replace

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.calibration.camera import FoundBoard
from controller.calibration.kinematics import KinematicsError, board_again
from controller.imaging import Camera

CAMERA = emulated_layout().overhead
X, Y = np.meshgrid(np.arange(0.0, 165.0, 15.0), np.arange(0.0, 120.0, 15.0))
GRID = np.stack([X.ravel(), Y.ravel()], axis=1)
HEIGHT_MM = 5.0


def seen(camera: Camera, x_mm: float = 280.0, y_mm: float = -60.0, turn: float = 0.0) -> FoundBoard:
    """The board's corners in a camera's picture."""
    c, s = np.cos(turn), np.sin(turn)
    p = GRID @ np.array([[c, s], [-s, c]]) + (x_mm, y_mm)
    pixels = camera.project(np.column_stack([p, np.full(len(p), HEIGHT_MM)]))
    return FoundBoard(GRID, pixels, 0.0, 0.0)


def moved(by_mm: tuple[float, float, float]) -> Camera:
    T = CAMERA.T_world_cam.copy()
    T[:3, 3] += by_mm
    return replace(CAMERA, T_world_cam=T)


def test_a_board_put_back_against_its_pins_is_no_fault() -> None:
    found = board_again(
        CAMERA, "overhead", seen(CAMERA), seen(CAMERA, 280.2, -60.1, 0.0003), HEIGHT_MM
    )
    # turned by 0.3 mrad about a corner 90 mm from its middle
    assert found.moved_mm == pytest.approx(np.hypot(0.2, 0.1), abs=0.05)
    assert found.turned_rad == pytest.approx(0.0003, rel=1e-3)
    assert found.grown == pytest.approx(0.0, abs=1e-9)
    assert found.fault is None


@pytest.mark.parametrize("by_mm", [(1.0, 0.0, 0.0), (0.0, -0.8, 0.0), (0.0, 0.0, 2.0)])
def test_a_camera_that_was_moved_is_named(by_mm: tuple[float, float, float]) -> None:
    found = board_again(CAMERA, "overhead", seen(CAMERA), seen(moved(by_mm)), HEIGHT_MM)
    assert found.fault is not None
    assert found.fault.kind == "camera_moved"
    assert "the camera overhead was moved" in found.fault.message


def test_a_camera_that_came_nearer_sees_a_larger_board_which_no_pins_explain() -> None:
    found = board_again(CAMERA, "overhead", seen(CAMERA), seen(moved((0, 0, -2.0))), HEIGHT_MM)
    # 1250 - 5 mm from the print at first
    assert found.grown == pytest.approx(1245 / 1243 - 1, rel=0.02)
    assert found.moved_mm < 0.5
    assert found.fault is not None


def test_only_corners_that_both_pictures_show_count() -> None:
    whole = seen(CAMERA)
    part = FoundBoard(whole.board_mm[40:], whole.pixels[40:], 0.0, 0.0)
    assert board_again(CAMERA, "overhead", whole, part, HEIGHT_MM).moved_mm < 1e-9
    few = FoundBoard(whole.board_mm[80:], whole.pixels[80:], 0.0, 0.0)
    with pytest.raises(KinematicsError, match="8 corners in both pictures"):
        board_again(CAMERA, "overhead", whole, few, HEIGHT_MM)
