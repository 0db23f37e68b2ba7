"""The hold of the arm's jaws: what a plate did in a shake is what two pictures of it differ by."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from planning_cell import emulated_layout
from scipy.spatial.transform import Rotation

from controller.bring_up import StepFailedError
from controller.bring_up.gauges.holding import shake
from controller.bring_up.procedure import StepFigure
from controller.calibration.camera import Charuco, FoundBoard, charuco_board
from controller.calibration.kinematics import BoardPicture, plate_faces
from controller.calibration.target import load_board

LAYOUT = emulated_layout()
BOARD = load_board(Path(__file__).parents[2] / "recipes" / "boards" / "paddle.json")
FRONT = plate_faces(BOARD)[0].T_body_board
Q = np.array([0.3, -0.6, 0.1, -300.0, -0.2, 0.4])
# the plate 650 mm before the camera, its front towards it
T_CAM_BODY = np.eye(4)
T_CAM_BODY[:3, :3] = Rotation.from_euler("x", 0.2).as_matrix() @ np.array(
    [[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]
)
T_CAM_BODY[:3, 3] = -40.0, 10.0, 650.0


class Evidence:
    def __init__(self) -> None:
        self.figures: list[StepFigure] = []
        self.findings = ["left out"]

    def measure(self, name: str, value: float, unit: str = "", **limits: Any) -> None:
        self.figures.append(
            StepFigure(name=name, value=value, unit=unit, uncertainty=None, low=None, **limits)
        )


class Plate:
    """A plate in the jaws that slips by a pose of its own frame once it has been shaken."""

    def __init__(self, slip: np.ndarray) -> None:
        self.plate = SimpleNamespace(board=BOARD)
        self.scene = SimpleNamespace(free=lambda q, margin_mm: np.ones(len(q), dtype=bool))
        self.slip, self.paths, self.is_seen = slip, list[np.ndarray](), True

    def configurations(self, *_: Any, **__: Any) -> np.ndarray:
        return Q[None]

    def within_reach(self, q: np.ndarray) -> bool:
        return bool(np.array_equal(q, Q))

    async def follow(self, path: Any) -> None:
        self.paths.append(np.array(path))

    async def shown(self, camera: str, q: np.ndarray, name: str, **_: Any) -> BoardPicture | None:
        if not self.is_seen:
            return None
        target = BOARD.build()
        assert isinstance(target, Charuco)
        p = np.asarray(charuco_board(target).getChessboardCorners(), dtype=float)
        T = T_CAM_BODY @ (self.slip if self.paths else np.eye(4)) @ FRONT
        in_cam = p @ T[:3, :3].T + T[:3, 3]
        lens = LAYOUT.inspection
        pixels = cv2.projectPoints(in_cam, np.zeros(3), np.zeros(3), lens.K, lens.distortion)[0]
        board = FoundBoard(p[:, :2], pixels.reshape(-1, 2), 0.0, 0.0)
        return BoardPicture(name, camera, "front", board, "plate", q)


def shaken(slip: np.ndarray, *, is_seen: bool = True) -> tuple[Plate, list[StepFigure]]:
    plate, evidence = Plate(slip), Evidence()
    plate.is_seen = is_seen
    bench: Any = SimpleNamespace(layout=LAYOUT, evidence=evidence, motion=plate)
    held: Any = plate
    asyncio.run(shake(bench, held))
    return plate, evidence.figures


def moved(along_mm: float, turn_deg: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", turn_deg, degrees=True).as_matrix()
    T[0, 3] = along_mm
    return T


def test_a_plate_that_stays_has_not_slipped_and_was_shaken() -> None:
    plate, (slip, turn) = shaken(np.eye(4))
    assert slip.value < 0.01
    assert turn.value < 0.01
    assert slip.is_within
    assert turn.is_within
    there = np.concatenate(plate.paths)
    assert len(there) > 20
    np.testing.assert_array_equal(there[-1], Q)
    # each swing goes to both sides
    assert ((there - Q).max(axis=0) > 0).sum() == ((there - Q).min(axis=0) < 0).sum() == 3


@pytest.mark.parametrize(("along_mm", "turn_deg"), [(0.8, 0.0), (0.0, 0.5), (-2.0, 1.0)])
def test_a_plate_that_slips_is_off_by_as_much(along_mm: float, turn_deg: float) -> None:
    _, (slip, turn) = shaken(moved(along_mm, turn_deg))
    # the middle of the plate is 60 mm from the frame that it turns about
    turn_mm = 60.0 * np.radians(turn_deg)
    assert slip.value == pytest.approx(np.hypot(along_mm, turn_mm), abs=0.05)
    assert turn.value == pytest.approx(turn_deg, abs=0.02)
    assert not (slip.is_within and turn.is_within)


def test_a_plate_that_is_not_found_is_missed() -> None:
    with pytest.raises(StepFailedError, match="held_before; left out"):
        shaken(np.eye(4), is_seen=False)
