"""OFF: counts, corners, polygons; colours and normals behind them are ignored."""

import re
from pathlib import Path
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IntArray

from ...errors import UnreadableCadError
from ..promises import check_promises
from .polygons import triangles_of
from .text import MeshText

HEADER: Final = re.compile(rb"(?i)(?:ST)?C?N?OFF\b")
ROW: Final = re.compile(rb"(?m)^[ \t]*([^\s#][^\n#]*)")
COUNT: Final = re.compile(rb"\d{1,12}")


def read_off(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    """Return corners (v, 3) in the file's unit and triangles (n, 3).

    Raises
    ------
    UnreadableCadError : no OFF, binary, cut short, or a row that is no corner or polygon
    CoordinatesCadError : a number is not finite
    LargeCadError : promises more triangles than a part is worth
    """
    text = MeshText.of(data, path).with_points(ROW)
    rows = ROW.finditer(text.data)
    try:
        first = next(rows)
        header = HEADER.match(first[1])
        words = first[1][header.end() if header else 0 :].split()
        if not words:
            first = next(rows)
            words = first[1].split()
        if len(words) < 2 or any(COUNT.fullmatch(word) is None for word in words[:2]):
            raise UnreadableCadError(
                f"{path}: is not OFF in text, despite its name; export it again"
            )
        corner_count, polygon_count = (int(word) for word in words[:2])
        check_promises({"corners": corner_count, "triangles": polygon_count}, len(data), path)
        vertices = np.empty((corner_count, 3))
        for k in range(corner_count):
            row = next(rows)
            tokens = row[1].split()[:3]
            if len(tokens) < 3:
                raise text.error(row.start(), "a corner has fewer than three coordinates")
            vertices[k] = [text.number(row.start(), token) for token in tokens]
        polygons = [_polygon(text, next(rows), corner_count) for _ in range(polygon_count)]
    except StopIteration:
        raise UnreadableCadError(f"{path}: the text breaks off; copy or export it again") from None
    return vertices, triangles_of(vertices, polygons)


def _polygon(text: MeshText, row: "re.Match[bytes]", corner_count: int) -> list[int]:
    tokens = row[1].split()
    size = int(tokens[0]) if COUNT.fullmatch(tokens[0]) else 0
    corners = tokens[1 : size + 1]
    if size < 1 or len(corners) < size:
        raise text.error(row.start(), "a polygon without its count of corners")
    for corner in corners:
        if COUNT.fullmatch(corner) is None or int(corner) >= corner_count:
            raise text.error(
                row.start(),
                f"a triangle names corner {corner.decode(errors='replace'):.40} of {corner_count}",
            )
    return [int(corner) for corner in corners]
