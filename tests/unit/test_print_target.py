"""Printed boards: areas of the size that their file names, found again, true to scale."""

from __future__ import annotations

import json
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest

from controller.bring_up.target_sheet import sheet_pdf
from controller.bring_up.target_sheet.areas import SheetError, lay_out
from controller.calibration.camera import find_board
from controller.calibration.target import BoardSection, load_board
from controller.cli.app import main
from controller.config.shipped import SHIPPED

MM_PER_POINT = 25.4 / 72
PX_PER_MM = 10
BOARDS = ("charuco", "chessboard", "paddle")


def board_named(name: str) -> BoardSection:
    return load_board(SHIPPED / "boards" / f"{name}.json")


@dataclass
class Drawn:
    """What a page's drawing operators draw, in mm from the paper's upper left corner."""

    filled: list[list[np.ndarray]] = field(default_factory=list)
    stroked: list[np.ndarray] = field(default_factory=list)


def operators(pdf: bytes) -> Drawn:
    """Return the areas and lines of a document, read from the operators of its pages."""
    drawn = Drawn()
    for packed in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.S):
        try:
            text = zlib.decompress(packed).decode("latin1")
        except zlib.error:
            continue
        if text.startswith("1 0 0 -1 0 "):
            _page(text, drawn)
    return drawn


def _page(text: str, drawn: Drawn) -> None:
    """Walk the operators of one page; its first one turns y down, as PDF 32000-1 8.3.4 has it."""
    words: list[str] = []
    subpaths: list[list[tuple[float, float]]] = []
    matrix, kept = np.eye(3), []
    for word in re.sub(r"\(.*?\)\s*Tj", "", text).split()[7:]:
        if re.fullmatch(r"-?[\d.]+", word):
            words.append(word)
            continue
        numbers = [float(w) for w in words]
        words = []
        if word == "q":
            kept.append(matrix)
        elif word == "Q":
            matrix = kept.pop()
        elif word == "cm":
            a, b, c, d, e, f = numbers
            matrix = matrix @ np.array([[a, c, e], [b, d, f], [0, 0, 1]])
        elif word == "m":
            subpaths.append([(numbers[0], numbers[1])])
        elif word == "l":
            subpaths[-1].append((numbers[0], numbers[1]))
        elif word == "re":
            x, y, w, h = numbers
            subpaths.append([(x, y), (x + w, y), (x + w, y + h), (x, y + h)])
        elif word in {"f", "f*", "S", "s", "n"}:
            rings = [_mm(points, matrix) for points in subpaths]
            if word.startswith("f"):
                drawn.filled.append(rings)
            elif word in {"S", "s"}:
                drawn.stroked += rings
            subpaths = []


def _mm(points: list[tuple[float, float]], matrix: np.ndarray) -> np.ndarray:
    there = np.column_stack([np.array(points), np.ones(len(points))]) @ matrix.T
    return there[:, :2] * MM_PER_POINT


def picture_of(drawn: Drawn) -> np.ndarray:
    """Return a page of A4, either way, drawn with 10 pixels a millimetre."""
    grey = np.full((300 * PX_PER_MM, 300 * PX_PER_MM), 230, np.uint8)
    for rings in drawn.filled:
        # pixel centres are whole numbers; 4 bits behind the point
        at = [np.rint((ring * PX_PER_MM - 0.5) * 16).astype(np.int32) for ring in rings]
        cv2.fillPoly(grey, at, 20, cv2.LINE_AA, shift=4)
    return cv2.GaussianBlur(grey, (0, 0), 1.5)


@pytest.mark.parametrize(
    ("name", "width_mm", "height_mm"),
    [("charuco", 12 * 15, 9 * 15), ("chessboard", 11 * 16, 8 * 16)],
)
def test_the_print_is_as_large_as_its_file_has_it(
    name: str, width_mm: float, height_mm: float
) -> None:
    drawn = operators(sheet_pdf(board_named(name), name, "a4"))
    points = np.concatenate([ring for rings in drawn.filled for ring in rings])
    assert np.ptp(points, axis=0) == pytest.approx((width_mm, height_mm), abs=0.01)


@pytest.mark.parametrize("name", BOARDS)
def test_the_ruler_is_100_mm_long(name: str) -> None:
    drawn = operators(sheet_pdf(board_named(name), name, "a4"))
    lengths = [float(np.hypot(*np.ptp(line, axis=0))) for line in drawn.stroked if len(line) == 2]
    assert max(lengths) == pytest.approx(100.0, abs=0.01)
    assert len(lengths) == 101 + 1  # a tick for each millimetre, and the line they stand on


@pytest.mark.parametrize("name", BOARDS)
def test_a_sheet_is_made_of_areas_and_holds_no_picture(name: str) -> None:
    pdf = sheet_pdf(board_named(name), name, "a4")
    assert b"/Image" not in pdf
    assert pdf == sheet_pdf(board_named(name), name, "a4")


@pytest.mark.parametrize("name", BOARDS)
def test_what_is_drawn_is_found_as_the_board_of_the_file(name: str) -> None:
    board = board_named(name)
    picture = picture_of(operators(sheet_pdf(board, name, "a4")))
    corner_count = np.prod(board.inner_corners or [n - 1 for n in board.squares or ()])
    for target in (board.build(), board.build_back()):
        if target is None:
            continue
        found = find_board(picture, target)
        assert len(found.board_mm) == corner_count
        # from board (y up) to picture (y down): nothing but a shift and the scale
        there = found.board_mm * (PX_PER_MM, -PX_PER_MM)
        error = found.pixels - there
        np.testing.assert_allclose(error, error.mean(axis=0) + np.zeros_like(error), atol=0.1)


def test_the_paddles_faces_are_apart_and_on_one_sheet() -> None:
    (page,) = lay_out(board_named("paddle"), "a4")
    (front, front_at), (back, back_at) = page.faces
    assert (front.name, back.name) == ("front", "back")
    assert back_at[0] >= front_at[0] + front.size_mm[0]
    assert back_at[0] + back.size_mm[0] <= page.paper_mm[0]
    assert front.size_mm == (90, 120)


def test_faces_that_do_not_fit_side_by_side_get_a_sheet_each() -> None:
    wide = BoardSection.model_validate(
        board_named("paddle").model_dump() | {"square_mm": 20.0, "marker_mm": 15.0}
    )
    pages = lay_out(wide, "letter")
    assert [[face.name for face, _ in page.faces] for page in pages] == [["front"], ["back"]]


def test_a_board_larger_than_the_paper_is_refused() -> None:
    large = BoardSection.model_validate(board_named("chessboard").model_dump() | {"square_mm": 40})
    with pytest.raises(SheetError, match=r"plate is 464 x 344 mm; a4 has 200 x 261 mm"):
        lay_out(large, "a4")


def test_the_board_file_describes_what_was_printed(tmp_path: Path) -> None:
    out = tmp_path / "board.pdf"
    words = ["print-target", "charuco", "-o", str(out), "--squares", "10x7", "--square-mm", "18"]
    assert main(words) == 0
    board = load_board(tmp_path / "board.json")
    assert (board.squares, board.square_mm) == ((10, 7), 18)
    assert board.marker_mm == pytest.approx(18 * 11 / 15)
    drawn = operators(out.read_bytes())
    points = np.concatenate([ring for rings in drawn.filled for ring in rings])
    assert np.ptp(points, axis=0) == pytest.approx((180, 126), abs=0.01)


def test_what_was_measured_goes_into_the_board_file(tmp_path: Path) -> None:
    words = ["print-target", "paddle", "-o", str(tmp_path / "p.pdf"), "--measured-mm", "84.42"]
    assert main(words) == 0
    assert not (tmp_path / "p.pdf").exists()
    body = json.loads((tmp_path / "p.json").read_text())
    # 84 mm were to be printed: half a percent too large
    assert body["square_mm"] == pytest.approx(12 * 1.005)
    assert body["marker_mm"] == pytest.approx(9 * 1.005)
    assert body["note"].endswith("measured 84.42 mm over all squares across")
