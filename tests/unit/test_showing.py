"""Configurations that show a held board to a camera: it is in the picture, and faces the camera."""

import cv2
import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.calibration.showing import TILT_RAD, ShowingRegion, showing
from controller.planning.geometry import Box
from controller.planning.motion import Scene, tcp_pose

LAYOUT = emulated_layout()
MIDDLE_MM = np.array([36.0, 36.0])
# a plate 90 x 120 x 10 held by its end: its print's x axis across the approach, z along the jaws
T_TCP_BOARD = np.eye(4)
T_TCP_BOARD[:3, :3] = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
T_TCP_BOARD[:3, 3] = 20.0, 5.0, -36.0
PLATE = Box.from_bounds(-25.0, 95.0, -5.0, 5.0, -45.0, 45.0)


@pytest.mark.parametrize("name", ["overhead", "inspection"])
def test_the_board_is_in_the_picture_and_turned_to_the_camera(name: str) -> None:
    camera = getattr(LAYOUT, name)
    scene = Scene(LAYOUT, 14.0, LAYOUT.fixed_open_mm, carried=PLATE)
    region = ShowingRegion(600.0, 900.0)
    q = showing(
        LAYOUT,
        scene,
        camera,
        T_TCP_BOARD,
        MIDDLE_MM,
        region,
        60,
        np.random.default_rng(3),
        margin_mm=20.0,
    )
    assert len(q) == 60
    assert LAYOUT.arm.within_limits(q).all()
    assert (scene.contacts(q, 19.9) < 0).all()
    assert (q[:, 1] > 0).any()
    assert (q[:, 1] < 0).any()
    R, t = camera.T_world_cam[:3, :3].T, -camera.T_world_cam[:3, :3].T @ camera.position_mm
    for T in tcp_pose(LAYOUT, q) @ T_TCP_BOARD:
        p_world = T[:3, :3] @ [*MIDDLE_MM, 0.0] + T[:3, 3]
        pixel = cv2.projectPoints(p_world[None], cv2.Rodrigues(R)[0], t, camera.K, None)[0].ravel()
        assert ((pixel > 0) & (pixel < camera.size_px)).all()
        to_eye = camera.position_mm - p_world
        depth = (R @ p_world + t)[2]
        assert region.near_mm - 1e-6 <= depth <= region.far_mm + 1e-6
        facing = T[:3, 2] @ to_eye / np.linalg.norm(to_eye)
        # a gripper nearly straight down is taken for straight down
        assert facing >= np.cos(TILT_RAD + 0.002)
