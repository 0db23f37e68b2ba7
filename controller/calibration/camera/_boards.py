"""Find a board in a picture by OpenCV, turn it the right way round, then fit each corner.

OpenCV finds boards best in pictures of several hundred to fifteen hundred pixels, so it gets the
picture enlarged or reduced. The corners are measured in the original picture.
"""

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import sample_picture
from messages import key, say

from ._corners import refine_corners
from ._types import Charuco, Chessboard, FoundBoard, Target

_USUAL_PX: Final = (700, 1600)  # a picture with a long side in this range is searched as it is
_WANTED_PX: Final = 1100
# If a row of squares beyond the board has more than this share of the chess pattern's contrast, the
# board goes on there.
_CONTINUES: Final = 0.4
# This share of neighbouring squares must be one black, one white; a few may have a reflection.
_ALTERNATING_MIN: Final = 0.9
_STRAY_SQUARES: Final = 0.25  # a ChArUco corner this far off the others' plane is a misread marker
_STRAY_PX: Final = 4.0  # the same while the plane is not known yet: a lens bends it by as much
_CORNERS_MIN: Final = 4  # this many points determine a homography


class NoBoardError(Exception):
    """A picture without such a board; the message gives the reason."""


def find_board(grey: Grey, target: Target) -> FoundBoard:
    """Return the board in a picture (height, width).

    A chessboard must be wholly in the picture. Of a ChArUco board, any four corners are enough.

    Raises
    ------
    NoBoardError : no board, too little of it, or a board other than the target's
    """
    if isinstance(target, Chessboard):
        return _chessboard(grey, target)
    return _charuco(grey, target)


def _sizes(grey: Grey) -> Iterator[Grey]:
    """Yield the picture in several sizes, the most promising first."""
    longest = max(grey.shape)
    if longest < _USUAL_PX[0]:
        scales = (1.0, _USUAL_PX[0] / longest, 2 * _USUAL_PX[0] / longest)
    elif longest <= _USUAL_PX[1]:
        scales = (1.0, 2.0, 0.5)
    else:
        usual = _WANTED_PX / longest
        scales = (usual, 2 * usual, usual / 2)
    for scale in scales:
        if scale == 1.0:
            yield grey
            continue
        way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        height, width = (max(1, round(side * scale)) for side in grey.shape)
        yield np.asarray(cv2.resize(grey, (width, height), interpolation=way), np.uint8)


def _unscaled(pixels: FloatArray, scaled: Grey, grey: Grey) -> FloatArray:
    """Return where pixels of the scaled picture are in the original; centres are whole numbers."""
    by = np.array(scaled.shape[::-1]) / np.array(grey.shape[::-1])
    out: FloatArray = (pixels + 0.5) / by - 0.5
    return out


# -- chessboards --------------------------------------------------------------------------------


def _chessboard(grey: Grey, target: Chessboard) -> FoundBoard:
    columns, rows = target.inner_corners
    grid = _right_way_up(grey, _search(grey, columns, rows), target)
    axes = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], axis=2)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    board_mm = target.square_mm * np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    return _measured(grey, board_mm, grid.reshape(-1, 2), axes.reshape(-1, 2, 2), None)


def _search(grey: Grey, columns: int, rows: int) -> FloatArray:
    """Return the inner corners (rows, columns, 2) in OpenCV's order."""
    for flags in (0, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE):
        for picture in _sizes(grey):
            found, corners = cv2.findChessboardCornersSB(picture, (columns, rows), flags=flags)
            if found:
                pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
                return _unscaled(pixels, picture, grey).reshape(rows, columns, 2)
        if np.ptp(cv2.GaussianBlur(grey, (0, 0), 2)) < 12:
            break  # an even grey has no board in any size
    raise NoBoardError(
        say(
            "no chessboard with {columns} x {rows} inner corners; all of it "
            "must be in the picture, with a white border",
            columns=columns,
            rows=rows,
        )
    )


def _right_way_up(grey: Grey, grid: FloatArray, target: Chessboard) -> FloatArray:
    """Return the corners in the target's order: Z out of the print, the first square black."""
    columns, rows = target.inner_corners
    x = (grid[:, -1] - grid[:, 0]).mean(axis=0)
    y = (grid[-1] - grid[0]).mean(axis=0)
    if x[0] * y[1] - x[1] * y[0] > 0:  # v runs down: Z would point into the print
        grid = grid[:, ::-1]
    wide = _continued(_continued(grid))
    centres = (wide[:-1, :-1] + wide[1:, :-1] + wide[:-1, 1:] + wide[1:, 1:]) / 4
    row, column = np.mgrid[0 : rows + 3, 0 : columns + 3]
    sign = np.where((row + column) % 2 == 0, -1.0, 1.0)  # black where the board's first square is
    sampled = sample_picture(grey, centres[..., 0], centres[..., 1], cv2.BORDER_REPLICATE)
    brightness = sampled.astype(np.float64)
    height, width = grey.shape
    seen = np.all((centres > 0) & (centres < (width - 1, height - 1)), axis=2)

    inner = np.s_[1:-1, 1:-1]
    contrast = _pattern(brightness[inner], sign[inner])
    if _alternating(brightness[inner], sign[inner]) < _ALTERNATING_MIN:
        raise NoBoardError(
            say(
                "the pattern found does not alternate as {columns} x {rows} inner "
                "corners would; check inner_corners in the target file",
                columns=columns,
                rows=rows,
            )
        )
    for beyond in (np.s_[0, 1:-1], np.s_[-1, 1:-1], np.s_[1:-1, 0], np.s_[1:-1, -1]):
        more = _pattern(brightness[beyond], sign[beyond]) / contrast
        if seen[beyond].all() and more > _CONTINUES:
            raise NoBoardError(
                say(
                    "the board has more than {columns} x {rows} inner corners; correct "
                    "inner_corners in the target file",
                    columns=columns,
                    rows=rows,
                )
            )
    if target.has_one_way_up and contrast < 0:
        grid = grid[::-1, ::-1]
    return grid


def _pattern(brightness: FloatArray, sign: FloatArray) -> float:
    """Return half the step from the squares of sign -1 to those of sign 1."""
    return float(brightness[sign > 0].mean() - brightness[sign < 0].mean()) / 2


def _alternating(brightness: FloatArray, sign: FloatArray) -> float:
    """Return the share of neighbouring squares between which black and white change."""
    down = (np.diff(brightness, axis=0) * sign[1:]).ravel()
    across = (np.diff(brightness, axis=1) * sign[:, 1:]).ravel()
    steps = np.concatenate([down, across])
    usual = np.median(steps)
    return float((steps / usual > 1 / 3).mean()) if usual else 0.0


def _continued(grid: FloatArray) -> FloatArray:
    """Return a grid (rows, columns, 2) with one more line of points on each side."""
    grid = np.concatenate([2 * grid[:1] - grid[1:2], grid, 2 * grid[-1:] - grid[-2:-1]])
    first, last = 2 * grid[:, :1] - grid[:, 1:2], 2 * grid[:, -1:] - grid[:, -2:-1]
    return np.concatenate([first, grid, last], axis=1)


# -- ChArUco ------------------------------------------------------------------------------------


def charuco_board(target: Charuco) -> cv2.aruco.CharucoBoard:
    """Return OpenCV's board.

    Raises
    ------
    ValueError : no such dictionary, or it has too few markers
    """
    number = getattr(cv2.aruco, target.dictionary, None)
    if number is None or not target.dictionary.startswith("DICT_"):
        raise ValueError(f"OpenCV knows no dictionary {target.dictionary}")
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    asked, there = target.squares[0] * target.squares[1] // 2, len(dictionary.bytesList)
    if target.first_marker + asked > there:
        begun = f" from {target.first_marker} on" if target.first_marker else ""
        raise ValueError(f"{target.dictionary} has {there} markers, the board needs {asked}{begun}")
    ids = target.first_marker + np.arange(asked, dtype=np.int32)
    board = cv2.aruco.CharucoBoard(
        target.squares, target.square_mm, target.marker_mm, dictionary, ids
    )
    board.setLegacyPattern(target.legacy_pattern)
    return board


def _charuco(grey: Grey, target: Charuco) -> FoundBoard:
    board = charuco_board(target)
    likely = cv2.aruco.CharucoParameters()
    likely.minMarkers = 1  # a corner next to one marker is accurate enough as a start
    detector = cv2.aruco.CharucoDetector(board, likely)
    corner_count = len(board.getChessboardCorners())
    seen: dict[int, FloatArray] = {}
    for picture in _sizes(grey):  # OpenCV may read small markers in one size and not in another
        corners, ids, _, _ = detector.detectBoard(picture)
        if ids is not None:
            pixels = _unscaled(np.asarray(corners, np.float64).reshape(-1, 2), picture, grey)
            for number, pixel in zip(np.ravel(ids), pixels, strict=True):
                seen.setdefault(int(number), pixel)
        if len(seen) == corner_count:
            break
    if len(seen) < _CORNERS_MIN:
        raise NoBoardError(
            say(
                "{seen_count} corners of the ChArUco board were found; check "
                "squares, dictionary and legacy_pattern, or show more of it",
                seen_count=len(seen),
            )
        )
    best_ids, best = np.array(list(seen)), np.array(list(seen.values()))
    order = np.argsort(best_ids)
    best_ids, best = best_ids[order], best[order]
    # OpenCV's frame lies at the print's upper left corner with Y down
    opencv_mm = np.asarray(board.getChessboardCorners(), dtype=np.float64)[best_ids, :2]
    first_row_mm = (target.squares[1] - 1) * target.square_mm
    board_mm = np.column_stack([opencv_mm[:, 0] - target.square_mm, first_row_mm - opencv_mm[:, 1]])
    straight = np.linalg.matrix_rank(board_mm - board_mm.mean(axis=0), tol=1e-6) < 2
    homography = None if straight else _homography(board_mm, best)
    if homography is None:
        raise NoBoardError(key("the ChArUco corners found are on one line; show more of the board"))
    there, axes = _through(homography, board_mm, target.square_mm)
    side_px = np.linalg.norm(axes, axis=2).max(axis=1)
    near = np.linalg.norm(best - there, axis=1) < _STRAY_SQUARES * side_px
    gap = (1.0 - target.marker_mm / target.square_mm) / 2
    return _measured(grey, board_mm[near], best[near], axes[near], gap)


def _homography(board_mm: FloatArray, pixels: FloatArray) -> FloatArray | None:
    """Return the homography (3, 3) that most corners agree with, None if there is none."""
    found, _ = cv2.findHomography(board_mm, pixels, cv2.RANSAC, _STRAY_PX)
    return None if found is None else np.asarray(found, dtype=np.float64)


def _through(
    homography: FloatArray, board_mm: FloatArray, square_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Return where a homography takes points (n, 2), and a square's two sides there (n, 2, 2)."""

    def taken(points: FloatArray) -> FloatArray:
        h = np.column_stack([points, np.ones(len(points))]) @ homography.T
        out: FloatArray = h[:, :2] / h[:, 2:]
        return out

    half = square_mm / 2
    sides = [taken(board_mm + step) - taken(board_mm - step) for step in ((half, 0), (0, half))]
    return taken(board_mm), np.stack(sides, axis=1)


# -- both ---------------------------------------------------------------------------------------


def _measured(
    grey: Grey, board_mm: FloatArray, pixels: FloatArray, axes: FloatArray, gap: float | None
) -> FoundBoard:
    fitted, blur, sound = refine_corners(grey, pixels, axes, marker_gap=gap)
    if _few(sound):
        raise NoBoardError(
            say(
                "{sum} of {sound_count} corners are sharp enough to be measured; "
                "focus, light evenly, keep the board still",
                sum=int(sound.sum()),
                sound_count=len(sound),
            )
        )
    side = float(np.linalg.norm(axes[sound], axis=2).min())
    return FoundBoard(board_mm[sound], fitted[sound], side, float(np.median(blur[sound])))


def _few(sound: BoolArray) -> bool:
    return int(sound.sum()) < max(_CORNERS_MIN, len(sound) // 2)
