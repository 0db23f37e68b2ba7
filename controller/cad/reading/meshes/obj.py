"""OBJ: corners (``v``) and faces (``f``); textures, normals, materials, lines are ignored."""

import re
from array import array
from pathlib import Path
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IntArray

from ...solid import check_count
from .polygons import triangles_of
from .text import MeshText

CORNER: Final = re.compile(rb"(?m)^[ \t]*v[ \t][^\n#]*")
FACE: Final = re.compile(rb"(?m)^[ \t]*f[ \t]")
ROW: Final = re.compile(rb"(?m)^[ \t]*([vf])[ \t]+([^\n#]*)")
INDEX: Final = re.compile(rb"([-+]?\d+)(?:/[-+]?\d*){0,2}")


def read_obj(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    """Return corners (v, 3) in the file's unit and triangles (n, 3).

    Indices count from 1; negative ones count back from the face's position in the file.

    Raises
    ------
    UnreadableCadError : no text, or a row that is no corner or face
    CoordinatesCadError : a number is not finite
    LargeCadError : more faces than a part is worth
    """
    text = MeshText.of(data, path)
    text = MeshText(path, re.sub(rb"\\[ \t]*\n", b" ", text.data))  # a row goes on behind a \
    check_count(sum(1 for _ in FACE.finditer(text.data)), str(path))
    text = text.with_points(CORNER)
    numbers, polygons = array("d"), []
    for row in ROW.finditer(text.data):
        tokens = row[2].split()
        if row[1] == b"v":
            if len(tokens) < 3:  # more are a weight or a colour
                raise text.error(row.start(), "a corner has fewer than three coordinates")
            numbers.extend(text.number(row.start(), token) for token in tokens[:3])
            continue
        if len(tokens) < 3:
            raise text.error(row.start(), "a face has fewer than three corners")
        polygons.append([_index(text, row.start(), t, len(numbers) // 3) for t in tokens])
    vertices = np.array(numbers).reshape(-1, 3)
    last = max((max(polygon) for polygon in polygons), default=-1)
    if last >= len(vertices):
        first = next(row for row in ROW.finditer(text.data) if _names(row, last))
        raise text.error(first.start(), f"a face names corner {last + 1} of {len(vertices)}")
    return vertices, triangles_of(vertices, polygons)


def _index(text: MeshText, at: int, token: bytes, corner_count: int) -> int:
    """Return the index of the corner, from 0, that a token of a face names."""
    match = INDEX.fullmatch(token)
    index = int(match[1]) if match and len(match[1]) < 12 else 0
    found = index - 1 if index > 0 else corner_count + index
    if index == 0 or found < 0:
        raise text.error(
            at,
            f"a face names corner {token.decode(errors='replace')!r:.40}; corners count from 1, or "
            f"from -1 back to -{corner_count}",
        )
    return found


def _names(row: "re.Match[bytes]", corner: int) -> bool:
    words = (token.partition(b"/")[0] for token in row[2].split())
    return row[1] == b"f" and any(int(word) == corner + 1 for word in words)
