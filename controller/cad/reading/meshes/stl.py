"""STL, binary and text: names of solids and normals of facets are ignored."""

import re
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IntArray

from ...errors import UnreadableCadError
from ...solid import check_count
from .text import NUMBER, MeshText

HEADER_BYTES: Final = 84  # 80 of text, then the count of triangles
TRIANGLE_BYTES: Final = 50
TRIANGLE: Final = np.dtype(
    [("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
# Last bytes of a text in which its last solid ends; other words may follow.
END_BYTES: Final = 1 << 16
AT_ONCE: Final = 300_000  # corners of a text that are converted to numbers together
NAME: Final = re.compile(rb"(?im)^[ \t]*(?:end[ \t]*)?solid\b[^\n]*")
CORNER: Final = re.compile(
    rb"(?i)\bvertex\s+(N)\s+(N)\s+(N)(?=\s+(?:vertex|end\s*loop)\b)".replace(b"N", NUMBER)
)
ANY_CORNER: Final = re.compile(rb"(?i)\bvertex\b[^\n]*")
FACET_END: Final = re.compile(rb"(?i)\bend\s*facet\b")
SOLID_END: Final = re.compile(rb"(?i)\bend\s*solid\b")


def is_binary(head: bytes, size: int) -> bool:
    """Return True for a binary STL, whose size agrees with the count in its header.

    Binary files too may begin with "solid", so the beginning does not decide.

    Parameters
    ----------
    head : the file's first bytes, `HEADER_BYTES` at least
    size : size of the file [bytes]
    """
    return size == HEADER_BYTES + TRIANGLE_BYTES * promised(head)


def promised(head: bytes) -> int:
    """Return the number of triangles stated in the header of a binary STL."""
    return int.from_bytes(head[HEADER_BYTES - 4 : HEADER_BYTES], "little")


def read_stl(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    """Return corners (3n, 3) in the file's unit and triangles (n, 3).

    Raises
    ------
    UnreadableCadError : neither binary nor text, or cut short
    CoordinatesCadError : a number is not finite
    LargeCadError : more triangles than a part is worth
    """
    if is_binary(data, len(data)):
        rows = np.frombuffer(data, TRIANGLE, promised(data), HEADER_BYTES)
        corners = rows["corners"].astype(np.float64).reshape(-1, 3)
    else:
        corners = _corners(MeshText.of(data, path))
    return corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3)


def _corners(text: MeshText) -> FloatArray:
    count = sum(1 for _ in FACET_END.finditer(text.data))
    check_count(count, str(text.path))
    if SOLID_END.search(text.data, max(len(text.data) - END_BYTES, 0)) is None:
        raise UnreadableCadError(f"{text.path}: the text breaks off; copy or export it again")
    if any(b"vertex" in name[0].lower() for name in NAME.finditer(text.data)):
        # blank, so that every byte stays in its place
        text = MeshText(text.path, NAME.sub(lambda name: b" " * len(name[0]), text.data))
    text = text.with_points(ANY_CORNER)
    corners = np.empty((3 * count, 3))
    found = CORNER.finditer(text.data)
    filled = 0
    while some := list(islice(found, AT_ONCE)):
        tokens = np.array([match.groups() for match in some], dtype=bytes)
        if filled + len(some) > len(corners):
            break
        corners[filled : filled + len(some)] = tokens.astype(np.float64)
        filled += len(some)
    corner_count = sum(1 for _ in ANY_CORNER.finditer(text.data))
    if not filled == corner_count == len(corners) or not np.isfinite(corners).all():
        raise _unlike(text)
    return corners


def _unlike(text: MeshText) -> Exception:
    """Return the error for the first invalid corner, or a facet with too few or too many."""
    for row in ANY_CORNER.finditer(text.data):
        tokens = row[0].split()[1:]
        for token in tokens[:3]:
            try:
                text.number(row.start(), token)
            except UnreadableCadError as error:
                return error
        if CORNER.match(text.data, row.start()) is None:
            return text.error(row.start(), "a corner has other than three coordinates")
    return UnreadableCadError(
        f"{text.path}: its facets have other than three corners each; copy or export it again"
    )
