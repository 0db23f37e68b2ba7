"""What verification makes of pictures: a plate is as predicted, or as far off as it was put."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.bring_up.boards import HeldPlate, load_plate
from controller.bring_up.errors import StepFailedError
from controller.bring_up.proof import length_study
from controller.bring_up.proof.hand_off import hand_off_lines
from controller.bring_up.steps.verify import holds_of, mean_hold, plate_offs
from controller.calibration.camera import Charuco, FoundBoard, charuco_board
from controller.calibration.kinematics import BoardPicture, plate_faces
from controller.calibration.showing import ShowingRegion, showing
from controller.calibration.target import load_board
from controller.imaging import Camera
from controller.planning.geometry import Box
from controller.planning.motion import Scene, tcp_pose
from messages.words import teller

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
        region = ShowingRegion(650.0, 900.0)
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


def test_each_picture_shows_how_the_plate_is_held() -> None:
    bench: Any = SimpleNamespace(layout=LAYOUT)
    found = mean_hold(holds_of(bench, BOARD, pictures(AS_CALIBRATED)))
    np.testing.assert_allclose(found, HELD, atol=1e-4)


def test_known_lengths_are_measured_where_cameras_are_as_calibrated() -> None:
    study = length_study(LAYOUT, BOARD, pictures(AS_CALIBRATED), HELD)
    # 7 squares of 12 mm: the inner corners are 60 mm apart (recipes/boards/paddle.json)
    assert study.reference_mm == (60.0, 60.0)
    assert study.off_mm.shape == (20, 2)
    assert np.abs(study.off_mm).max() < 1e-3
    assert study.grr_mm < 1e-3


def test_a_lens_that_is_longer_than_calibrated_shows_between_the_cameras() -> None:
    K = AS_CALIBRATED["inspection"].K.copy()
    K[:2, :2] *= 1.002
    longer = AS_CALIBRATED | {"inspection": replace(AS_CALIBRATED["inspection"], K=K)}
    study = length_study(LAYOUT, BOARD, pictures(longer), HELD)
    # one camera is right, the other 0.2 % of 60 mm too long
    assert study.bias_mm == pytest.approx(0.06, rel=0.05)
    assert study.setup_mm == pytest.approx(0.12 / np.sqrt(2), rel=0.05)
    assert study.repeatability_mm < 0.01


def test_corners_that_jitter_show_as_repeatability() -> None:
    rng, shaken = np.random.default_rng(3), []
    for one in pictures(AS_CALIBRATED):
        scale = 1.0 + rng.normal(0.0, 0.001)
        middle = one.board.pixels.mean(axis=0)
        pixels = middle + scale * (one.board.pixels - middle)
        shaken.append(replace(one, board=replace(one.board, pixels=pixels)))
    study = length_study(LAYOUT, BOARD, shaken, HELD)
    # 0.1 % of 60 mm, from twenty draws
    assert 0.03 < study.repeatability_mm < 0.1
    assert study.grr_mm >= study.repeatability_mm


def test_lengths_of_one_camera_alone_are_no_study() -> None:
    own = [one for one in pictures(AS_CALIBRATED) if one.camera == "overhead"]
    with pytest.raises(StepFailedError, match="two pictures of each camera"):
        length_study(LAYOUT, BOARD, own, HELD)


def test_a_hand_off_brings_the_plates_far_end_between_the_fixed_pads() -> None:
    nominal = np.eye(4)
    nominal[0, 3] = -LAYOUT.arm_gripper.pad_centre_mm
    plate = HeldPlate(BOARD, nominal)
    scene = Scene(LAYOUT, 12.0, LAYOUT.fixed_open_mm, carried=plate.box)
    bench: Any = SimpleNamespace(layout=LAYOUT)
    held: Any = SimpleNamespace(plate=plate)
    lines = hand_off_lines(bench, held, scene)
    assert lines
    assert LAYOUT.fixed_gripper is not None
    for line in lines:
        T = np.linalg.inv(LAYOUT.T_world_fixed_tcp) @ tcp_pose(LAYOUT, line[-1])
        # held by the middle of its bare 30 mm, the plate ends 105 mm farther along the approach
        far = T @ (nominal[0, 3] + 105.0, 0.0, 0.0, 1.0)
        pads_mm = LAYOUT.fixed_gripper.pad_centre_mm
        assert np.hypot(far[0] + pads_mm, far[2]) == pytest.approx(12.0, abs=1e-6)
        assert far[1] == pytest.approx(0.0, abs=1e-6)
        # its faces are parallel to the pads
        assert abs(T[1, 1]) == pytest.approx(1.0, abs=1e-9)
        first = tcp_pose(LAYOUT, line[0])[:3, 3]
        assert np.linalg.norm(first - tcp_pose(LAYOUT, line[-1])[:3, 3]) == pytest.approx(130.0)


def test_a_board_that_is_no_plate_is_refused_before_anything_moves() -> None:
    boards = Path(__file__).parents[2] / "recipes" / "boards"
    assert load_plate(boards / "paddle.json") == BOARD
    is_none = r"chessboard.json: is no plate .*ChArUco.*bare_mm"
    with pytest.raises(StepFailedError, match=is_none) as refused:
        load_plate(boards / "chessboard.json")
    assert "ein Druck auf der Rückseite" in teller("de")(str(refused.value))
    with pytest.raises(StepFailedError, match=r"charuco.json: is no plate .*back_first_marker"):
        load_plate(boards / "charuco.json")
