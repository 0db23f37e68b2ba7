"""PLY, binary and text: corners and polygons; colours, normals, comments are ignored."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray, IntArray

from ...errors import UnreadableCadError
from ..promises import check_promises
from .polygons import triangles_of
from .text import MeshText

TYPES: Final[Mapping[bytes, str]] = MappingProxyType(
    {
        spelling: code
        for spellings, code in (
            (b"char int8", "i1"), (b"uchar uint8", "u1"), (b"short int16", "i2"),
            (b"ushort uint16", "u2"), (b"int int32", "i4"), (b"uint uint32", "u4"),
            (b"float float32", "f4"), (b"double float64", "f8"),
        )
        for spelling in spellings.split()
    }
)  # fmt: skip
ORDERS: Final = MappingProxyType(
    {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
)
HEADER: Final = re.compile(rb"\A(?:\xef\xbb\xbf)?ply[ \t]*(\r\n|\n|\r)")
HEADER_BYTES: Final = 1 << 16
CORNERS_OF_A_FACE: Final = frozenset({b"vertex_indices", b"vertex_index"})
KINDS: Final = MappingProxyType({b"vertex": "corners", b"face": "triangles"})
NUMBERS: Final = re.compile(rb"(?m)^[^\n]*")


@dataclass(frozen=True, slots=True)
class Property:
    """One property: its name, its type, and the type of the count in front where it is a list."""

    name: bytes
    code: str
    count_code: str | None = None


@dataclass(frozen=True, slots=True)
class Element:
    """A table of the file: ``count`` rows of the same properties."""

    name: bytes
    count: int
    properties: tuple[Property, ...]


def read_ply(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    """Return corners (v, 3) in the file's unit and triangles (n, 3).

    Raises
    ------
    UnreadableCadError : no PLY, cut short, without corners or faces, or with strips of triangles
    CoordinatesCadError : a number of a text is not finite
    LargeCadError : promises more triangles than a part is worth
    """
    if HEADER.match(data) is None:  # in UTF-16, which is text
        data = MeshText.of(data, path).data
    match = HEADER.match(data)
    end = data.find(b"end_header", 0, HEADER_BYTES)
    if match is None or end < 0:
        raise UnreadableCadError(f"{path}: is not PLY, despite its name; export it again")
    order, elements = _header(data[match.end() : end], path)
    check_promises({KINDS.get(e.name, "other rows"): e.count for e in elements}, len(data), path)
    order = _require_mesh(order, elements, path)
    begin = data.find(match[1], end) + len(match[1])
    read = _text_rows if order == "" else _binary_rows
    try:
        vertices, polygons = read(memoryview(data)[begin:], order, elements, path)
    except (StopIteration, IndexError):
        raise UnreadableCadError(f"{path}: breaks off; copy or export it again") from None
    last = max((max(polygon, default=-1) for polygon in polygons), default=-1)
    if last >= len(vertices) or any(min(polygon, default=0) < 0 for polygon in polygons):
        raise UnreadableCadError(
            f"{path}: a triangle names corner {last} of {len(vertices)}; export it again"
        )
    return vertices, triangles_of(vertices, polygons)


def _header(header: bytes, path: Path) -> tuple[str | None, tuple[Element, ...]]:
    """Return the elements, and the byte order: empty for text, None for an unknown one."""
    order: str | None = None
    found: list[Element] = []
    for words in (line.split() for line in header.splitlines()):
        if words[:1] == [b"format"] and len(words) > 1:
            order = ORDERS.get(words[1])
        elif words[:1] == [b"element"] and len(words) == 3 and words[2].isdigit():
            found.append(Element(words[1], int(words[2][:15]), ()))
        elif words[:1] == [b"property"] and found:
            known = found.pop()
            one = _property(words[1:])
            if one is None:
                raise UnreadableCadError(
                    f"{path}: its header has a property of no known type; export it again"
                )
            found.append(Element(known.name, known.count, (*known.properties, one)))
    return order, tuple(found)


def _require_mesh(order: str | None, elements: tuple[Element, ...], path: Path) -> str:
    """Return the byte order of a file that has corners and faces."""
    names = {element.name: {p.name for p in element.properties} for element in elements}
    if order is None or not {b"x", b"y", b"z"} <= names.get(b"vertex", set()):
        raise UnreadableCadError(f"{path}: its header names no corners; export it again")
    if not CORNERS_OF_A_FACE & names.get(b"face", set()):
        raise UnreadableCadError(
            f"{path}: holds no faces; export the solid as triangles, not as points or strips"
        )
    return order


def _property(words: list[bytes]) -> Property | None:
    if len(words) == 2 and words[0] in TYPES:
        return Property(words[1], TYPES[words[0]])
    if len(words) == 4 and words[0] == b"list" and words[1] in TYPES and words[2] in TYPES:
        return Property(words[3], TYPES[words[2]], TYPES[words[1]])
    return None


def _text_rows(
    body: memoryview, _: str, elements: tuple[Element, ...], path: Path
) -> tuple[FloatArray, list[list[int]]]:
    text = MeshText.of(bytes(body), path).with_points(NUMBERS)
    rows = (row for row in NUMBERS.finditer(text.data) if row[0].strip())
    vertices, polygons = np.empty((0, 3)), list[list[int]]()
    for element in elements:
        if element.name == b"vertex":
            vertices = np.empty((element.count, 3))
            places = [
                [p.name for p in element.properties].index(axis) for axis in (b"x", b"y", b"z")
            ]
            for k in range(element.count):
                row = next(rows)
                tokens = row[0].split()
                vertices[k] = [text.number(row.start(), tokens[place]) for place in places]
        else:
            for _row in range(element.count):
                row = next(rows)
                if element.name == b"face":
                    polygons.append(_text_polygon(text, row, element))
    return vertices, polygons


def _text_polygon(text: MeshText, row: "re.Match[bytes]", element: Element) -> list[int]:
    tokens, at = row[0].split(), 0
    try:
        for one in element.properties:
            size = 1 if one.count_code is None else int(tokens[at])
            at += one.count_code is not None
            if one.name in CORNERS_OF_A_FACE:
                if len(tokens) < at + size:
                    break
                return [int(token) for token in tokens[at : at + size]]
            at += size
    except ValueError:
        pass
    raise text.error(row.start(), "a face without its count of corners")


def _binary_rows(
    body: memoryview, order: str, elements: tuple[Element, ...], path: Path
) -> tuple[FloatArray, list[list[int]]]:
    vertices, polygons = np.empty((0, 3)), list[list[int]]()
    at = 0
    for element in elements:
        rows = table = _uniform(body, at, order, element)
        if table is not None:
            at += table.nbytes
        else:
            rows, at = _each(body, at, order, element)
        if element.name == b"vertex":
            columns = [
                [row[axis] for row in rows] if table is None else table[axis] for axis in "xyz"
            ]
            vertices = np.column_stack(columns).astype(np.float64)
        elif element.name == b"face":
            name = next(p.name for p in element.properties if p.name in CORNERS_OF_A_FACE).decode()
            polygons = (
                [row[name].tolist() for row in rows] if table is None else table[name].tolist()
            )
    return vertices, polygons


def _uniform(body: memoryview, at: int, order: str, element: Element) -> Any:  # noqa: ANN401
    """Return the rows of an element as a table, where its lists are all as long as in the first."""
    if element.count == 0:
        return np.empty(
            0, [(p.name.decode(errors="replace"), order + p.code) for p in element.properties]
        )
    fields: list[Any] = []
    end = at
    for number, one in enumerate(element.properties):
        size: tuple[int, ...] = ()
        if one.count_code is not None:
            size = (_scalar(body, end, order + one.count_code),)
            fields.append((f"count {number}", order + one.count_code))
            end += np.dtype(one.count_code).itemsize
        fields.append((one.name.decode(errors="replace"), order + one.code, size))
        end += np.dtype(one.code).itemsize * (size[0] if size else 1)
    kind = np.dtype(fields)
    if at + kind.itemsize * element.count > len(body):
        return None
    table = np.frombuffer(body, kind, element.count, at)
    counts = [name for name, *_ in fields if name.startswith("count ")]
    return table if all((table[name] == table[name][0]).all() for name in counts) else None


def _each(
    body: memoryview, at: int, order: str, element: Element
) -> tuple[list[dict[str, Any]], int]:
    """Return each row of an element as a mapping, and the byte behind them."""
    rows = []
    for _ in range(element.count):
        row: dict[str, Any] = {}
        for one in element.properties:
            size = 1
            if one.count_code is not None:
                size = _scalar(body, at, order + one.count_code)
                at += np.dtype(one.count_code).itemsize
            kind = np.dtype(order + one.code)
            if at + size * kind.itemsize > len(body):
                raise IndexError
            values = np.frombuffer(body, kind, size, at)
            at += values.nbytes
            row[one.name.decode(errors="replace")] = values if one.count_code else values[0]
        rows.append(row)
    return rows, at


def _scalar(body: memoryview, at: int, code: str) -> int:
    if at + np.dtype(code).itemsize > len(body):
        raise IndexError
    value = int(np.frombuffer(body, code, 1, at)[0])
    if value < 0:
        raise IndexError
    return value
