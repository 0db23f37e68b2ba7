"""Files of printed boards: what they describe, and what they are refused for."""

from pathlib import Path

import pytest

from controller.calibration.target import load_board
from controller.config import ConfigError

BOARDS = Path(__file__).parents[2] / "recipes" / "boards"


def test_the_paddles_plate_is_the_print_with_a_margin_and_a_bare_side_to_hold_it_by() -> None:
    paddle = load_board(BOARDS / "paddle.json")
    # 7 squares of 12 mm, 3 mm on each side, 30 mm bare below
    assert paddle.plate_mm == (90.0, 120.0, 10.0)
    assert paddle.build_back() is not None


@pytest.mark.parametrize("name", ["charuco", "chessboard"])
def test_a_flat_board_fits_the_picture_of_the_overhead_camera(name: str) -> None:
    board = load_board(BOARDS / f"{name}.json")
    width_mm, height_mm, thickness_mm = board.plate_mm
    # recipes/cells/emulated.yaml: 1280 x 1024 px, 3571 px from 1250 mm
    mm_per_px = (1250.0 - thickness_mm) / 3571.0
    assert width_mm < 0.6 * 1280 * mm_per_px
    assert height_mm < 0.6 * 1024 * mm_per_px
    assert board.build_back() is None


def test_no_marker_of_the_boards_is_on_two_of_their_faces() -> None:
    faces = []
    for name in ("charuco", "paddle"):
        board = load_board(BOARDS / f"{name}.json")
        faces += [board.build(), board.build_back()]
    ids = []
    for face in faces:
        if face is not None:
            columns, rows = face.squares  # type: ignore[union-attr]
            first = face.first_marker  # type: ignore[union-attr]
            ids += range(first, first + columns * rows // 2)
    assert len(ids) == 54 + 24 + 24
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('{"inner_corners": [7, 6], "square_mm": 9, "back_first_marker": 3}', "chessboard"),
        (
            '{"squares": [7, 7], "square_mm": 12, "marker_mm": 9, "dictionary": "DICT_4X4_50",'
            ' "back_first_marker": 40}',
            "has 50 markers",
        ),
        ('{"inner_corners": [7, 6], "square_mm": 9, "thickness_mm": 0}', "thickness_mm"),
    ],
)
def test_a_board_that_cannot_be_is_refused(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "board.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=match):
        load_board(path)
