"""Printed boards: a chessboard or ChArUco print on a plate, read from the board's own file.

The file is docs/commissioning.md's. A board's frame lies in its print: z out of it, x to the right,
y up, origin in the inner corner at the lower left. Markers are OpenCV's.
"""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from .layout import LayoutError, load_plain
from .matter.solid import Solid, solid_of
from .shapes import Array

PLATE_KG_PER_MM3: Final = 1500e-9  # aluminium on both sides of a plastic core
HELD_OFF_MM: Final = 3.0  # a person leaves this much of the bare side before the fingers' ends
_SQUARES_MAX: Final = 101
_KEYS: Final = frozenset(
    (
        *("inner_corners", "squares", "square_mm", "marker_mm", "dictionary", "legacy_pattern"),
        *("first_marker", "back_first_marker", "thickness_mm", "margin_mm", "bare_mm"),
        *("board_frame", "note", "images", "world"),
    )
)


@dataclass(frozen=True, slots=True, eq=False)
class Print:
    """One face as a grid of rectangles, in the frame of its own print, z = 0.

    Attributes
    ----------
    x_mm, y_mm : (columns + 1,), (rows + 1,) lines of the grid, ascending
    is_dark : (rows, columns) bool
    """

    x_mm: Array
    y_mm: Array
    is_dark: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """A plate with a print on its upper face, and maybe one on the lower.

    Attributes
    ----------
    key : differs between boards that differ
    low_mm, high_mm : (3,) corners of the plate in the board's frame; the upper face is z = 0
    front, back : prints of both faces; without a print on it, one bright rectangle
    T_board_back : (4, 4) pose of the print of the lower face
    bare_mm : height of bare plate at its lower side
    """

    name: str
    key: str
    low_mm: Array
    high_mm: Array
    front: Print
    back: Print
    T_board_back: Array
    bare_mm: float

    def solid(self) -> Solid:
        """Return the plate as a body."""
        import trimesh

        mesh = trimesh.creation.box(bounds=(self.low_mm, self.high_mm))
        return solid_of(mesh, self.name, PLATE_KG_PER_MM3, is_convex=True)

    def pose_on_table(
        self, x_mm: float, y_mm: float, theta_rad: float, tilt_rad: float = 0.0
    ) -> Array:
        """Return T_world_board of the board on the table, its print up.

        Parameters
        ----------
        x_mm, y_mm : origin of its frame, seen from above
        theta_rad : theta of its x axis against the world's, seen from above if it is flat
        tilt_rad : about its x axis; positive lifts its upper side. It then stands on one edge
        """
        c, s = math.cos(theta_rad), math.sin(theta_rad)
        ct, st = math.cos(tilt_rad), math.sin(tilt_rad)
        T = np.eye(4)
        turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
        T[:3, :3] = turn @ np.array(((1.0, 0.0, 0.0), (0.0, ct, -st), (0.0, st, ct)))
        ends = np.array((self.low_mm, self.high_mm))
        lowest_mm = float(sum((ends[:, i] * T[2, i]).min() for i in range(3)))
        T[:3, 3] = x_mm, y_mm, -lowest_mm
        return T

    def pose_in_jaws(self) -> Array:
        """Return T_tcp_board as a person hands it: the bare side between the pads, print outside.

        Its normal is along the jaws' axis y, its y along the approach x, the plate's middle between
        the pads.

        Raises
        ------
        ValueError : it has no bare side to hold it by
        """
        if self.bare_mm <= 0.0:
            raise ValueError(f"{self.name} has no bare side to hold it by (`bare_mm`)")
        middle = (self.low_mm + self.high_mm) / 2.0
        T = np.eye(4)
        T[:3, :3] = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
        held = np.array((middle[0], self.low_mm[1] + self.bare_mm, middle[2]))
        T[:3, 3] = np.array((HELD_OFF_MM, 0.0, 0.0)) - T[:3, :3] @ held
        return T


def read_board(path: Path, scale: float = 1.0) -> Board:
    """Return the board that a file describes.

    Parameters
    ----------
    path : the board's own file, or a target file with pictures, which do not matter here
    scale : scale of the print about its origin, as a printer enlarges it; the plate stays as it is

    Raises
    ------
    LayoutError : the file cannot be read, or is no board's; the print does not fit on its plate
    """
    try:
        raw = load_plain(path)
    except OSError as error:
        raise LayoutError(f"{path}: {error.strerror or error}") from error
    except Exception as error:
        raise LayoutError(f"{path}: neither JSON nor YAML: {error}") from error
    if not isinstance(raw, dict):
        raise LayoutError(f"{path}: a board is a mapping, found {type(raw).__name__}")
    try:
        return _board(path.stem, raw, scale)
    except KeyError as error:
        raise LayoutError(f"{path}: entry {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise LayoutError(f"{path}: {error}") from error


def _board(name: str, raw: dict[str, Any], scale: float) -> Board:
    if unknown := sorted(set(raw) - _KEYS):
        raise ValueError(f"unknown entry {unknown[0]!r}")
    square_mm, margin_mm = float(raw["square_mm"]), float(raw.get("margin_mm", 10.0))
    bare_mm, thickness_mm = float(raw.get("bare_mm", 0.0)), float(raw.get("thickness_mm", 5.0))
    for key, value in (("square_mm", square_mm), ("thickness_mm", thickness_mm), ("scale", scale)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"`{key}` {value:g}: more than 0")
    if not (margin_mm >= 0.0 and bare_mm >= 0.0):
        raise ValueError("`margin_mm` and `bare_mm` are 0 or more")
    columns, rows = _squares(raw)
    low = np.array((-square_mm - margin_mm, -square_mm - margin_mm - bare_mm, -thickness_mm))
    high = np.array(((columns - 1) * square_mm + margin_mm, (rows - 1) * square_mm + margin_mm, 0))
    outline = (low, high)
    back = raw.get("back_first_marker")
    T_board_back = np.diag((-1.0, 1.0, -1.0, 1.0))
    T_board_back[0, 3], T_board_back[2, 3] = (columns - 2) * square_mm, -thickness_mm
    return Board(
        name=name,
        key=hashlib.sha256(repr((sorted(raw.items(), key=str), scale)).encode()).hexdigest(),
        low_mm=low,
        high_mm=high,
        front=_printed(raw, int(raw.get("first_marker", 0)), scale, outline),
        back=_bare(outline) if back is None else _printed(raw, int(back), scale, outline),
        T_board_back=T_board_back,
        bare_mm=bare_mm,
    )


def _squares(raw: dict[str, Any]) -> tuple[int, int]:
    """Return columns and rows of squares."""
    is_chess = "inner_corners" in raw
    if is_chess == ("squares" in raw):
        raise ValueError("either `inner_corners` of a chessboard or `squares` of a ChArUco board")
    first, second = raw["inner_corners"] if is_chess else raw["squares"]
    columns, rows = int(first) + is_chess, int(second) + is_chess
    if not (2 <= columns <= _SQUARES_MAX and 2 <= rows <= _SQUARES_MAX):
        raise ValueError(f"{columns} x {rows} squares: 2 to {_SQUARES_MAX} are possible")
    return columns, rows


def _bare(outline: tuple[Array, Array]) -> Print:
    low, high = outline
    return Print(
        np.array((low[0], high[0])), np.array((low[1], high[1])), np.zeros((1, 1), dtype=bool)
    )


def _printed(
    raw: dict[str, Any], first_marker: int, scale: float, outline: tuple[Array, Array]
) -> Print:
    square_mm = float(raw["square_mm"])
    columns, rows = _squares(raw)
    if "inner_corners" in raw:
        lines, tiles = np.array((0.0, square_mm)), _chess(columns, rows)
    else:
        lines, tiles = _charuco(raw, columns, rows, first_marker)
    x_mm, y_mm = (_all_lines(lines, count, square_mm) * scale for count in (columns, rows))
    low, high = outline
    if x_mm[0] < low[0] or y_mm[0] < low[1] or x_mm[-1] > high[0] or y_mm[-1] > high[1]:
        raise ValueError(f"printed at {scale:g} of its size it does not fit on the plate")
    # (rows, columns, lines - 1, lines - 1), rows from below -> one grid, with the margin around it
    grid = tiles.transpose(0, 2, 1, 3).reshape(len(y_mm) - 1, len(x_mm) - 1)
    x_mm, (left, right) = _with_margin(x_mm, low[0], high[0])
    y_mm, (below, above) = _with_margin(y_mm, low[1], high[1])
    return Print(x_mm, y_mm, np.pad(grid, ((below, above), (left, right))))


def _all_lines(lines: Array, count: int, square_mm: float) -> Array:
    """Return the lines of a row of squares, from the first square's outer side at -square."""
    starts = (np.arange(count) - 1.0) * square_mm
    every: Array = np.append((starts[:, None] + lines[:-1]).ravel(), starts[-1] + square_mm)
    return every


def _with_margin(lines: Array, low: float, high: float) -> tuple[Array, tuple[int, int]]:
    """Return lines with those of the plate's sides, and how many were added at either end."""
    before, after = int(lines[0] > low), int(lines[-1] < high)
    return np.concatenate(([low] * before, lines, [high] * after)), (before, after)


def _chess(columns: int, rows: int) -> NDArray[np.bool_]:
    """Return a mask of the dark squares: the one at the lower left, and every other one."""
    row, column = np.mgrid[:rows, :columns]
    return np.asarray((row + column) % 2 == 0)[:, :, None, None]


def _charuco(
    raw: dict[str, Any], columns: int, rows: int, first_marker: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Return lines within a square [mm], and which of its rectangles are dark, rows from below."""
    square_mm, marker_mm = float(raw["square_mm"]), float(raw["marker_mm"])
    if not 0.0 < marker_mm < square_mm:
        raise ValueError(f"`marker_mm` {marker_mm:g}: between 0 and `square_mm` {square_mm:g}")
    name = str(raw["dictionary"])
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if number is None:
        raise ValueError(f"OpenCV knows no dictionary {name}")
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    bits = dictionary.markerSize + 2  # with its black border
    gap_mm = (square_mm - marker_mm) / 2.0
    inner = gap_mm + marker_mm * np.arange(bits + 1) / bits
    lines = np.concatenate(((0.0,), inner, (square_mm,)))
    tiles = np.zeros((rows, columns, bits + 2, bits + 2), dtype=bool)
    is_dark_first = not (bool(raw.get("legacy_pattern")) and rows % 2 == 0)
    marker = first_marker
    for from_top in range(rows):
        for column in range(columns):
            row = rows - 1 - from_top
            if ((from_top + column) % 2 == 0) == is_dark_first:
                tiles[row, column] = True
                continue
            if not 0 <= marker < len(dictionary.bytesList):
                raise ValueError(f"{name} has no marker {marker}")
            drawn = cv2.aruco.generateImageMarker(dictionary, marker, bits)
            tiles[row, column, 1:-1, 1:-1] = drawn[::-1] == 0
            marker += 1
    return lines, tiles
