"""Stored board pictures against the camera that is known to have taken them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from data_files import BOARDS, true_pictures

from controller.calibration.camera import View, calibrate, find_board
from controller.calibration.target import load_target
from controller.imaging import Camera

pytestmark = pytest.mark.slow
# the digitiser's raster over the camera's: u_lo = (u + 0.5) / 5 - 0.5, v_lo = (v + 0.5) / 4 - 0.5
LO_HI = np.array([[0.2, 0, -0.4], [0, 0.25, -0.375], [0, 0, 1]])


def _true_camera(lo: bool) -> Camera:
    told = true_pictures()["camera"]
    T_cam_world = np.eye(4)
    T_cam_world[:3, :3], T_cam_world[:3, 3] = told["R_wc"], told["t_wc"]
    K = np.array(told["K"])
    size = (256, 256) if lo else (told["width"], told["height"])
    return Camera(size, LO_HI @ K if lo else K, np.array(told["dist"]), np.linalg.inv(T_cam_world))


def _views(prefix: str) -> tuple[list[View], Any]:
    target = load_target(BOARDS / "calib.json")
    views = []
    for entry in target.images:
        path: Path = BOARDS / f"{prefix}{entry.image}"
        grey = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
        board = find_board(grey, target.build())
        views.append(View(entry.image, target.placed(entry.image), board))
    return views, target.world.build() if target.world is not None else None


@pytest.mark.parametrize(("prefix", "corner_px"), [("", 0.035), ("lo_", 0.012)])
def test_the_camera_of_the_stored_pictures_is_found(prefix: str, corner_px: float) -> None:
    truth = _true_camera(lo=bool(prefix))
    views, world = _views(prefix)
    assert len(views) == 14
    # every corner against the board's true pose: 0.14 mm at 4 px/mm would be half a pixel
    for view in views:
        T = np.array(true_pictures()["boards"][view.name])
        flat = np.column_stack([view.board.board_mm, np.zeros(len(view.board.board_mm))])
        off = view.board.pixels - truth.project(flat @ T[:3, :3].T + T[:3, 3])
        assert np.sqrt((off**2).sum(axis=1).mean()) < corner_px
    found = calibrate(views, truth.size_px, world)
    assert found.rms_px < corner_px
    error = np.abs(found.camera.position_mm - truth.position_mm)
    assert (error < 3 * found.position_std_mm).all()
    assert (found.position_std_mm < 0.25).all()
    width, height = truth.size_px
    u, v = np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 27))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    for plane in found.table:
        z = plane.height_mm
        off = np.linalg.norm(found.camera.on_plane(pixels, z) - truth.on_plane(pixels, z), axis=1)
        # the boards' print may lie some hundredths of a mm over the table they define
        assert off.max() < 3 * plane.worst_mm + 0.005
        assert np.median(off) < 3 * plane.median_mm + 0.005
