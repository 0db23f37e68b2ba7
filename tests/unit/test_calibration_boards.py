"""Boards found in drawn pictures: corners to a hundredth of a pixel, and the right way round."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from board_pictures import (
    camera_over_table,
    corners_of,
    picture_of,
    pose,
    true_pixels,
)

from controller.calibration.camera import (
    Charuco,
    Chessboard,
    NoBoardError,
    charuco_board,
    find_board,
    refine_corners,
)

BOARD = Chessboard((7, 4), 10.0)
CHARUCO = Charuco((6, 5), 14.0, 9.0, "DICT_4X4_50")
# pixels 5 : 4, as an old digitiser has them, and a lens that bends 2 px at the corners
CAMERA = camera_over_table((256, 200), (560.0, 700.0), (-0.2, 0.1, 0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return picture_of(CAMERA, pose(-30, -15, 0, 8), BOARD)


@pytest.mark.parametrize("turn_deg", [97.0, 185.0, -80.0])
def test_a_board_is_found_the_same_way_round_however_it_is_turned(turn_deg: float) -> None:
    middle = corners_of(BOARD).mean(axis=0)
    T = pose(0, 0, 0, turn_deg, (6, -4))
    T[:3, 3] -= T[:3, :2] @ middle
    found = find_board(picture_of(CAMERA, T, BOARD), BOARD)
    np.testing.assert_array_equal(found.board_mm, corners_of(BOARD))
    error = found.pixels - true_pixels(CAMERA, T, found.board_mm)
    # 1 grey level of noise in 200 over some 10 px of edge
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.03
    assert np.abs(error.mean(axis=0)).max() < 0.01


def test_a_board_whose_even_count_runs_along_x_goes_from_black_to_white_along_y() -> None:
    turned = Chessboard((4, 7), 10.0)
    T = pose(-15, -30, 0, -5)
    found = find_board(picture_of(CAMERA, T, turned), turned)
    expected = true_pixels(CAMERA, T, corners_of(turned))
    np.testing.assert_allclose(found.pixels, expected, atol=0.1)


def test_half_a_turn_of_the_picture_turns_the_corners_and_not_the_board(
    picture: np.ndarray,
) -> None:
    found = find_board(picture, BOARD)
    turned = find_board(np.ascontiguousarray(picture[::-1, ::-1]), BOARD)
    height, width = picture.shape
    back = np.array([width - 1, height - 1]) - turned.pixels
    np.testing.assert_allclose(back, found.pixels, atol=2e-3)


def test_a_quarter_turn_of_the_picture_turns_the_corners_and_not_the_board(
    picture: np.ndarray,
) -> None:
    found = find_board(picture, BOARD)
    turned = find_board(np.ascontiguousarray(np.rot90(picture)), BOARD)
    _, width = picture.shape
    u, v = turned.pixels.T
    back = (width - 1 - v, u)
    np.testing.assert_allclose(np.column_stack(back), found.pixels, atol=2e-3)


def test_half_the_light_moves_no_corner(picture: np.ndarray) -> None:
    dim = np.rint(picture * 0.5 + 20).astype(np.uint8)
    bright, dark = find_board(picture, BOARD), find_board(dim, BOARD)
    # rounding to whole grey levels is all that differs: 0.3 levels of 100
    np.testing.assert_allclose(dark.pixels, bright.pixels, atol=0.02)


def test_over_exposed_white_moves_no_corner() -> None:
    T = pose(-30, -15, 0, 8)
    clean = picture_of(CAMERA, T, BOARD, noise=0.0).astype(float)
    burnt = np.clip(clean * 1.5, 0, 255).astype(np.uint8)
    error = find_board(burnt, BOARD).pixels - true_pixels(CAMERA, T, corners_of(BOARD))
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.03


def test_corners_of_sharp_edges_along_the_rows_are_not_pulled_to_whole_pixels() -> None:
    # pixels are exact means over an X of two edges along rows and columns, 0.3 px off the raster
    axis = np.arange(41) - 20
    for shift in (0.0, 0.15, 0.3, 0.45):
        step = np.clip(axis - shift, -0.5, 0.5) * 2  # a pixel's mean of the sign
        grey = np.rint(120 + 90 * np.outer(step, step)).astype(np.uint8)
        start = np.array([[20.0, 20.0]])
        axes = np.array([[[18.0, 0.0], [0.0, 18.0]]])
        found, _, sound = refine_corners(grey, start, axes)
        assert sound.all()
        np.testing.assert_allclose(found[0], 20.0 + shift, atol=0.012)


def test_light_that_falls_off_moves_no_corner() -> None:
    axis = np.arange(41) - 20.0
    sign = np.tanh((axis - 0.2) / 1.2)
    light = np.linspace(1.3, 0.7, 41)[None, :]  # twice as bright on the left
    grey = np.rint(light * (90 + 80 * np.outer(sign, sign))).astype(np.uint8)
    axes = np.array([[[18.0, 0.0], [0.0, 18.0]]])
    found, _, _ = refine_corners(grey, np.array([[20.0, 20.0]]), axes)
    np.testing.assert_allclose(found[0], 20.2, atol=0.005)


def test_a_charuco_board_counts_when_a_third_of_it_is_hidden() -> None:
    T = pose(-28, -20, 0, 12, (8, -6))
    grey = picture_of(CAMERA, T, CHARUCO)
    whole = find_board(grey, CHARUCO)
    grey[:, :110] = 90  # a hand
    part = find_board(grey, CHARUCO)
    assert 8 <= len(part.pixels) < len(whole.pixels) <= 20
    for found in (whole, part):
        error = found.pixels - true_pixels(CAMERA, T, found.board_mm)
        assert np.linalg.norm(error, axis=1).max() < 0.1
        assert np.sqrt((error**2).sum(axis=1).mean()) < 0.04


def test_a_charuco_boards_origin_is_its_lower_left_inner_corner() -> None:
    # in OpenCV's own drawing, 20 px a square, the inner corner at the lower left
    columns, rows = CHARUCO.squares
    drawn = charuco_board(CHARUCO).generateImage((columns * 40, rows * 40))
    drawn = np.pad(drawn, 30, constant_values=255)
    found = find_board(drawn, CHARUCO)
    expected = np.column_stack(
        [
            30 + 40 * (found.board_mm[:, 0] / 14.0 + 1) - 0.5,
            30 + 40 * (rows - 1 - found.board_mm[:, 1] / 14.0) - 0.5,
        ]
    )
    np.testing.assert_allclose(found.pixels, expected, atol=0.05)
    assert found.board_mm.min() == 0.0


def test_an_empty_table_is_no_board() -> None:
    with pytest.raises(NoBoardError, match="7 x 4 inner corners"):
        find_board(np.full((200, 256), 80, dtype=np.uint8), BOARD)
    with pytest.raises(NoBoardError, match="0 corners of the ChArUco"):
        find_board(np.full((200, 256), 80, dtype=np.uint8), CHARUCO)


@pytest.mark.slow
def test_a_board_with_fewer_squares_than_said_is_not_taken_for_it(picture: np.ndarray) -> None:
    with pytest.raises(NoBoardError, match="9 x 6 inner corners"):
        find_board(picture, Chessboard((9, 6), 10.0))


@pytest.mark.parametrize("inner_corners", [(7, 3), (6, 3)])
def test_a_part_of_a_larger_board_is_not_taken_for_a_smaller_one(
    picture: np.ndarray, inner_corners: tuple[int, int]
) -> None:
    # OpenCV finds smaller boards in larger ones, even by leaving out a row
    with pytest.raises(NoBoardError, match="inner_corners in the target file"):
        find_board(picture, Chessboard(inner_corners, 10.0))


def test_a_dictionary_with_too_few_markers_is_named() -> None:
    with pytest.raises(ValueError, match="DICT_4X4_50 has 50 markers, the board needs 70"):
        charuco_board(Charuco((14, 10), 10.0, 7.0, "DICT_4X4_50"))


def test_a_board_with_other_markers_is_not_taken_for_this_one() -> None:
    # OpenCV's own picture of markers 20 to 34; the board below wants 0 to 14
    columns, rows = CHARUCO.squares
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    other = cv2.aruco.CharucoBoard((columns, rows), 14.0, 9.0, dictionary, np.arange(20, 35))
    drawn = np.full((rows * 40 + 60, columns * 40 + 60), 200, np.uint8)
    drawn[30:-30, 30:-30] = other.generateImage((columns * 40, rows * 40))
    with pytest.raises(NoBoardError):
        find_board(drawn, CHARUCO)
    found = find_board(drawn, replace(CHARUCO, first_marker=20))
    assert len(found.board_mm) == (columns - 1) * (rows - 1)


def test_the_last_marker_of_a_board_must_be_in_its_dictionary() -> None:
    charuco_board(replace(CHARUCO, first_marker=35))
    with pytest.raises(ValueError, match="has 50 markers, the board needs 15 from 36 on"):
        charuco_board(replace(CHARUCO, first_marker=36))
