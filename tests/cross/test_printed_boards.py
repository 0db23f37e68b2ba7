"""Printed boards in the emulated cell: the calibration finds in their pictures what is true."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from controller.calibration.camera import NoBoardError, charuco_board, find_board
from controller.calibration.target import BoardSection, load_board
from emulators.world import (
    Layout,
    LayoutError,
    PictureMaker,
    board_surface,
    build_scene,
    read_board,
    read_layout,
)
from emulators.world.boards import Print
from emulators.world.pictures.sensor import Exposure, develop

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
BOARDS = ROOT / "recipes" / "boards"
RING = 1  # the order of the lamps in the cell file
CORNER_PX = 0.03
LEGACY = (
    '{"squares": [5, 4], "square_mm": 20, "marker_mm": 14, "dictionary": "DICT_5X5_50",'
    ' "legacy_pattern": true, "first_marker": 7}'
)


@pytest.fixture(scope="module")
def layout() -> Layout:
    return read_layout(ROOT / "recipes" / "cells" / "emulated.yaml")


def seen(layout: Layout, file: Path, T_world_board: Array, scale: float = 1.0) -> NDArray[np.uint8]:
    """Return the overhead camera's picture of a board under the ring, with the sensor's noise."""
    maker = PictureMaker(build_scene(layout, []))
    maker.add(board_surface("board", read_board(file, scale)))
    radiance = maker.radiance(0, {"board": T_world_board}, {RING: 1.0})
    return develop(radiance, Exposure(0.010, seed=11)).astype(np.uint8)


def pixels_of(layout: Layout, points_mm: Array, T_world_print: Array) -> Array:
    """Return where OpenCV projects points (n, 3) of a print."""
    camera = layout.cameras["overhead"]
    T = np.linalg.inv(camera.T_world_cam) @ T_world_print
    K = np.diag((camera.focal_px, camera.focal_px, 1.0))
    K[:2, 2] = camera.centre_px
    there, _ = cv2.projectPoints(points_mm, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], K,
                                 camera.distortion)  # fmt: skip
    return np.asarray(there[:, 0], dtype=np.float64)


@pytest.mark.parametrize(
    ("name", "at", "blur_px"),
    [
        ("charuco", (300.0, -60.0, 0.3, 0.0), 0.6),
        ("chessboard", (300.0, -40.0, 0.9, 0.4), 1.1),
    ],
)
def test_corners_of_a_board_are_where_the_truth_projects_to(
    layout: Layout, name: str, at: tuple[float, float, float, float], blur_px: float
) -> None:
    cameras = {key: replace(one, blur_px=blur_px) for key, one in layout.cameras.items()}
    file = BOARDS / f"{name}.json"
    T = read_board(file).pose_on_table(*at)
    found = find_board(seen(replace(layout, cameras=cameras), file, T), load_board(file).build())
    points = np.column_stack((found.board_mm, np.zeros(len(found.board_mm))))
    off = found.pixels - pixels_of(layout, points, T)
    assert np.linalg.norm(off, axis=1).max() < CORNER_PX
    # no bias: what is left over is noise, of which the mean of some ten corners is free
    assert np.abs(off.mean(axis=0)).max() < CORNER_PX / 5.0


def test_the_other_face_of_the_paddle_is_the_front_seen_from_behind(layout: Layout) -> None:
    file = BOARDS / "paddle.json"
    board = load_board(file)
    front, back = board.build(), board.build_back()
    assert back is not None
    # half a turn about its y axis, so that the plate's lower face, 10 mm under the print, is up;
    # then a turn on the table: edges along the pixels' rows are where the fit of corners is weak
    c, s = np.cos(0.3), np.sin(0.3)
    T = np.array(((-c, -s, 0, 400), (-s, c, 0, -30), (0, 0, -1, 120), (0, 0, 0, 1)), dtype=float)
    picture = seen(layout, file, T)
    with pytest.raises(NoBoardError):
        find_board(picture, front)
    found = find_board(picture, back)
    # squares of 12 mm, 7 of them: the middle of the print is 2.5 squares from the origin
    points = np.column_stack((60.0 - found.board_mm[:, 0], found.board_mm[:, 1],
                              np.full(len(found.board_mm), -10.0)))  # fmt: skip
    off = found.pixels - pixels_of(layout, points, T)
    assert len(off) == 36
    assert np.linalg.norm(off, axis=1).max() < CORNER_PX


def test_a_print_that_the_printer_enlarged_is_larger_about_its_origin(layout: Layout) -> None:
    file = BOARDS / "charuco.json"
    T = read_board(file).pose_on_table(310.0, -70.0, 0.2)
    found = find_board(seen(layout, file, T, scale=1.01), load_board(file).build())
    points = np.column_stack((found.board_mm * 1.01, np.zeros(len(found.board_mm))))
    off = found.pixels - pixels_of(layout, points, T)
    assert np.linalg.norm(off, axis=1).max() < CORNER_PX


def drawn(face: Print, size_px: tuple[int, int], print_mm: Array) -> NDArray[np.uint8]:
    """Return a print as a drawing, row 0 at the top, by looking up the middle of each pixel."""
    (x0, x1), (y0, y1) = print_mm
    x = x0 + (np.arange(size_px[0]) + 0.5) / size_px[0] * (x1 - x0)
    y = y1 - (np.arange(size_px[1]) + 0.5) / size_px[1] * (y1 - y0)
    column = np.searchsorted(face.x_mm, x) - 1
    row = np.searchsorted(face.y_mm, y) - 1
    return np.where(face.is_dark[row][:, column], 0, 255).astype(np.uint8)


@pytest.mark.parametrize("which", ["charuco", "paddle", "its back", "legacy"])
def test_a_charuco_print_is_the_one_that_opencv_draws(tmp_path: Path, which: str) -> None:
    file = BOARDS / f"{'paddle' if which == 'its back' else which}.json"
    if which == "legacy":
        file = tmp_path / "legacy.json"
        file.write_text(LEGACY)
    section: BoardSection = load_board(file)
    board = read_board(file)
    target = section.build_back() if which == "its back" else section.build()
    face = board.back if which == "its back" else board.front
    columns, rows = target.squares  # type: ignore[union-attr]  # ChArUco, all of them
    square = section.square_mm
    # pixels a square, so that every line of the print falls between two pixels
    side_px = {"charuco": 90, "paddle": 48, "its back": 48, "legacy": 60}[which]
    size_px = (columns * side_px, rows * side_px)
    span = np.array(((-square, (columns - 1) * square), (-square, (rows - 1) * square)))
    expected = charuco_board(target).generateImage(size_px)  # type: ignore[arg-type]
    differ = drawn(face, size_px, span) != expected
    # OpenCV rounds a marker's side to whole pixels: lines may be one pixel off
    assert not cv2.erode(differ.astype(np.uint8), np.ones((3, 3))).any()
    assert differ.mean() < 0.02


def test_the_controllers_plate_is_the_emulators() -> None:
    for name in ("charuco", "chessboard", "paddle"):
        board = read_board(BOARDS / f"{name}.json")
        plate = load_board(BOARDS / f"{name}.json").plate_mm
        assert board.high_mm - board.low_mm == pytest.approx(plate)


@pytest.mark.parametrize(
    ("text", "scale", "match"),
    [
        ("[1]", 1.0, "mapping"),
        ('{"square_mm": 10}', 1.0, "inner_corners"),
        ('{"inner_corners": [7, 6], "square_mm": 9, "colour": "red"}', 1.0, "colour"),
        ('{"inner_corners": [7, 6]}', 1.0, "square_mm"),
        ('{"inner_corners": [7, 6], "square_mm": 9, "margin_mm": 0.1}', 1.01, "does not fit"),
        (LEGACY.replace("5X5_50", "9X9_50"), 1.0, "DICT_9X9_50"),
        (LEGACY.replace(": 7}", ": 45}"), 1.0, "no marker 50"),
        (LEGACY.replace("14", "21"), 1.0, "marker_mm"),
    ],
)
def test_the_emulator_refuses_a_board_that_cannot_be(
    tmp_path: Path, text: str, scale: float, match: str
) -> None:
    file = tmp_path / "board.json"
    file.write_text(text)
    with pytest.raises(LayoutError, match=match):
        read_board(file, scale)
