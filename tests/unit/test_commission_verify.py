"""What verification makes of pictures: a plate is as predicted, or as far off as it was put."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.cell.commissioning.steps.verify import plate_offs
from controller.commissioning.calibration import Charuco, FoundBoard, charuco_board
from controller.commissioning.kinematics import BoardPicture, plate_faces
from controller.commissioning.showing import Region, showing
from controller.commissioning.target import load_board
from controller.imaging import Camera
from controller.planning.geometry import Box
from controller.planning.motion import Scene, tcp_pose

LAYOUT = emulated_layout()
BOARD = load_board(Path(__file__).parents[2] / "recipes" / "boards" / "paddle.json")
FACES = dict(zip(("front", "back"), plate_faces(BOARD), strict=True))
PLATE = Box.from_bounds(-45.0, 105.0, -9.0, 9.0, -50.0, 50.0)
HELD = np.eye(4)
HELD[:3, :3] = cv2.Rodrigues(np.array([0.01, 0.03, -0.008]))[0]
HELD[:3, 3] = -11.0, 0.3, 1.5


def corners() -> np.ndarray:
    target = BOARD.build()
    assert isinstance(target, Charuco)
    return np.asarray(charuco_board(target).getChessboardCorners(), dtype=float)


def pictures(true: dict[str, Camera]) -> list[BoardPicture]:
    """Ten pictures of each camera, as these cameras take them of a plate held in ``HELD``."""
    found = []
    p = corners()
    for name, camera in true.items():
        nominal = np.eye(4)
        nominal[0, 3] = -12.0
        T_tcp_board = nominal @ FACES["front"].T_body_board
        region = Region(650.0, 900.0)
        scene = Scene(LAYOUT, 14.0, LAYOUT.fixed_open_mm, carried=PLATE)
        rng = np.random.default_rng(4)
        middle = p[:, :2].mean(axis=0)
        q = showing(
            LAYOUT, scene, getattr(LAYOUT, name), T_tcp_board, middle, region, 10, rng, margin_mm=10
        )
        for number, row in enumerate(q):
            T = tcp_pose(LAYOUT, row) @ HELD @ FACES["front"].T_body_board
            R, t = camera.T_world_cam[:3, :3].T, camera.T_world_cam[:3, 3]
            in_cam = (p @ T[:3, :3].T + T[:3, 3] - t) @ R.T
            pixels = cv2.projectPoints(
                in_cam, np.zeros(3), np.zeros(3), camera.K, camera.distortion
            )[0].reshape(-1, 2)
            board = FoundBoard(p[:, :2], pixels, 0.0, 0.0)
            found.append(BoardPicture(f"{name}{number}", name, "front", board, "plate", row))
    return found


def offs(true: dict[str, Camera]) -> dict[Any, np.ndarray]:
    return plate_offs(SimpleNamespace(layout=LAYOUT), BOARD, pictures(true))  # type: ignore[arg-type]


AS_CALIBRATED = {"overhead": LAYOUT.overhead, "inspection": LAYOUT.inspection}


def test_a_cell_that_is_as_calibrated_leaves_nothing() -> None:
    for off in offs(AS_CALIBRATED).values():
        assert off.shape == (10, 2)
        assert off[:, 0].max() < 1e-3
        assert off[:, 1].max() < 1e-3


@pytest.mark.parametrize("moved", ["overhead", "inspection"])
def test_a_camera_that_was_moved_shows_by_as_much(moved: str) -> None:
    T = AS_CALIBRATED[moved].T_world_cam.copy()
    T[:3, 3] += T[:3, 0] * 2.0  # along its rows
    found = offs(AS_CALIBRATED | {moved: replace(AS_CALIBRATED[moved], T_world_cam=T)})
    # both cameras share one hold of the plate, so that each is off by about half
    both_mm = np.concatenate([off[:, 0] for off in found.values()])
    assert both_mm.max() > 0.9
    assert both_mm.max() < 2.5
