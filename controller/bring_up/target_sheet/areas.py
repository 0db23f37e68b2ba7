"""Printed boards as areas in millimetres: their black areas, and the layout on the sheet.

Frame of a face: the upper left corner of the plate, x to the right, y down [mm]. A face shows its
print as somebody sees it who looks at it with the bare side down.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from shapely import Polygon, box, unary_union

from controller.arrays import FloatArray
from controller.calibration.camera import Charuco, Chessboard, Target, charuco_board
from controller.calibration.target import BoardSection

EDGE_MM: Final = 5.0  # most printers leave this border of the paper bare
FOOT_MM: Final = 26.0  # space below the faces for ruler and words
GAP_MM: Final = 8.0  # space between two faces for a cut
RULER_MM: Final = 100.0
PAPERS_MM: Final = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}

Area = tuple[FloatArray, ...]


class SheetError(ValueError):
    """A board that does not fit on the paper; the message names a size that does."""


@dataclass(frozen=True, slots=True, eq=False)
class PlateFace:
    """One printed face of a plate.

    Attributes
    ----------
    name : "front" or "back"
    size_mm : width and height of the plate
    print_at_mm : upper left corner of the print
    print_mm : width and height of the print, all of its squares
    black : each area an outline (n, 2) and the outlines of what is white in it
    """

    name: str
    size_mm: tuple[float, float]
    print_at_mm: tuple[float, float]
    print_mm: tuple[float, float]
    black: tuple[Area, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SheetPage:
    """A sheet of paper.

    Attributes
    ----------
    paper_mm : its width and height
    faces : with the position of each face's upper left corner on the paper [mm]
    foot_mm : upper left corner of what stands below: ruler and words
    """

    paper_mm: tuple[float, float]
    faces: tuple[tuple[PlateFace, tuple[float, float]], ...]
    foot_mm: tuple[float, float]


def faces_of(board: BoardSection) -> tuple[PlateFace, ...]:
    """Return the printed faces of a board, the front first."""
    prints = {"front": board.build(), "back": board.build_back()}
    at = np.full(2, board.margin_mm)
    width_mm, height_mm, _ = board.plate_mm
    return tuple(
        PlateFace(
            name=name,
            size_mm=(width_mm, height_mm),
            print_at_mm=(board.margin_mm, board.margin_mm),
            print_mm=board.print_mm,
            black=tuple(tuple(ring + at for ring in area) for area in black_areas(target)),
        )
        for name, target in prints.items()
        if target is not None
    )


def black_areas(target: Target) -> tuple[Area, ...]:
    """Return the black areas of a print, from its upper left corner [mm], y down."""
    return tuple(_charuco(target) if isinstance(target, Charuco) else _chessboard(target))


def lay_out(board: BoardSection, paper: str) -> tuple[SheetPage, ...]:
    """Return the sheets of a board: all faces on one if there is room, else one for each.

    Parameters
    ----------
    board : as its file describes it
    paper : a key of `PAPERS_MM`

    Raises
    ------
    SheetError : the plate is larger than the paper allows
    """
    faces = faces_of(board)
    width_mm, height_mm = PAPERS_MM[paper]
    for group in (faces, faces[:1]):
        wide_mm = sum(face.size_mm[0] for face in group) + GAP_MM * (len(group) - 1)
        high_mm = group[0].size_mm[1]
        for across_mm, down_mm in ((width_mm, height_mm), (height_mm, width_mm)):
            if wide_mm <= across_mm - 2 * EDGE_MM and high_mm <= down_mm - 2 * EDGE_MM - FOOT_MM:
                paper_mm = (across_mm, down_mm)
                per_page = len(group)
                return tuple(
                    _page(faces[first : first + per_page], paper_mm, wide_mm)
                    for first in range(0, len(faces), per_page)
                )
    raise SheetError(
        f"the plate is {faces[0].size_mm[0]:g} x {faces[0].size_mm[1]:g} mm; {paper} has "
        f"{width_mm - 2 * EDGE_MM:g} x {height_mm - 2 * EDGE_MM - FOOT_MM:g} mm for it, or "
        f"{height_mm - 2 * EDGE_MM:g} x {width_mm - 2 * EDGE_MM - FOOT_MM:g} mm across"
    )


def _page(faces: tuple[PlateFace, ...], paper_mm: tuple[float, float], wide_mm: float) -> SheetPage:
    x_mm = (paper_mm[0] - wide_mm) / 2
    placed = []
    for face in faces:
        placed.append((face, (x_mm, EDGE_MM)))
        x_mm += face.size_mm[0] + GAP_MM
    foot_y_mm = EDGE_MM + faces[0].size_mm[1]
    return SheetPage(paper_mm, tuple(placed), ((paper_mm[0] - RULER_MM) / 2, foot_y_mm))


def _chessboard(target: Chessboard) -> Iterator[Area]:
    """Yield the squares; the one at the lower left is black."""
    columns, rows = (count + 1 for count in target.inner_corners)
    for row in range(rows):
        for column in range(columns):
            if (column + rows - 1 - row) % 2 == 0:
                yield _square(column, row, target.square_mm)


def _charuco(target: Charuco) -> Iterator[Area]:
    """Yield the squares without a marker, and the black areas of each marker."""
    board = charuco_board(target)
    (columns, rows), side = target.squares, target.square_mm
    # OpenCV: four corners of each marker from the upper left, y down
    corners = np.asarray(board.getObjPoints(), dtype=np.float64)[..., :2]
    bearing = {(int(x // side), int(y // side)) for x, y in corners.mean(axis=1)}
    for row in range(rows):
        for column in range(columns):
            if (column, row) not in bearing:
                yield _square(column, row, side)
    dictionary = board.getDictionary()
    cells = dictionary.markerSize + 2  # its black border is one cell wide
    for number, four in zip(np.ravel(board.getIds()), corners, strict=True):
        bits = dictionary.generateImageMarker(int(number), cells, borderBits=1) == 0
        cell_mm = target.marker_mm / cells
        squares = [
            box(column, row, column + 1, row + 1) for row, column in np.argwhere(bits)
        ]  # whole numbers, so that neighbours merge without a seam
        whole = unary_union(squares)
        for polygon in getattr(whole, "geoms", [whole]):
            yield tuple(four[0] + cell_mm * ring for ring in _rings(polygon))


def _rings(polygon: Polygon) -> Iterator[FloatArray]:
    for ring in (polygon.exterior, *polygon.interiors):
        yield np.asarray(ring.simplify(0).coords, dtype=np.float64)[:-1]


def _square(column: int, row: int, side_mm: float) -> Area:
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)
    return (side_mm * (corners + np.array([column, row])),)
