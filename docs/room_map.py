"""Draws docs/pictures/map.svg: ``python docs/room_map.py > docs/pictures/map.svg``.

The map of the code on one page: the packages of `controller`, `drivers` and `emulators` with what
each is for, by the first line of its docstring. The controller is in the layers of its import
contract (pyproject.toml); packages of `drivers` and `emulators` stand above those that they import.
Arrows in the controller are its real imports, without those that follow from others: from a room,
arrows lead to everything that it imports. A test fails when the drawing is out of date.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import pairwise, permutations, product
from pathlib import Path
from typing import Final

import grimp

ROOT: Final = Path(__file__).parents[1]
TOPS: Final = ("controller", "drivers", "emulators", "messages")
CONTRACT: Final = "imports of the controller run downwards"

# Sizes [px]. GitHub shows 1000 px of drawing in a column of 830 to 880, where its text is legible.
WIDTH: Final = 1000
MARGIN: Final = 14
PAD: Final = 12
ABREAST: Final = 2  # rooms of a layer in a row; more would leave their text a column of words
GAP: Final = 16  # between layers, where arrows run
CLOSE: Final = 6  # between rooms of one layer, one above the other
BESIDE: Final = 10  # between rooms of one layer, side by side
BETWEEN: Final = 40  # the frames of drivers and emulators
GUTTER: Final = 44  # beside the controller's layers, for arrows that pass some of them
LANE: Final = 8  # between arrows of one gutter
HEAD: Final = 46  # of a frame, with its name and purpose
ONE_LINE: Final = 28  # a room with one line of text
FIRST: Final = 19  # from the top of a room to its first line
LINE: Final = 15
TEXT: Final = 12
NAME: Final = 14.5  # its letters are 13, and bold ones are wider

TO: Final = "\N{RIGHTWARDS ARROW}"
NARROW: Final = "iljtfrI.,:;'|!()[]/- "
WIDE: Final = f"mwMW@{TO}"
WIRES: Final = "No import: bytes on real wires, as between the real machines"

STYLE: Final = """
svg { font-family: system-ui, "Segoe UI", Helvetica, Arial, sans-serif; font-size: 12px; }
.page { fill: #ffffff; }
.frame { fill: #f3f5f8; stroke: #c3cad3; }
.room { fill: #ffffff; stroke: #8594a6; }
.name { fill: #0b4f8a; font-weight: 600; font-size: 13px; }
.top { font-size: 15px; }
.text { fill: #2b333d; }
.note { fill: #55606d; font-style: italic; }
.arrow, .wire { fill: none; stroke: #55606d; stroke-width: 1.2; }
.wire { stroke: #b3541e; stroke-width: 1.6; stroke-dasharray: 5 3; }
.tip { fill: #55606d; }
.wire-tip { fill: #b3541e; }
@media (prefers-color-scheme: dark) {
  .page { fill: #0d1117; }
  .frame { fill: #151b23; stroke: #3a434e; }
  .room { fill: #1f2731; stroke: #6b7887; }
  .name { fill: #7cbcf5; }
  .text { fill: #d9dfe6; }
  .note { fill: #a3adb9; }
  .arrow { stroke: #a3adb9; }
  .wire { stroke: #f0955a; }
  .tip { fill: #a3adb9; }
  .wire-tip { fill: #f0955a; }
}
"""
TIP: Final = (
    '<marker id="{name}" class="{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
    'markerHeight="7" orient="auto-start-reverse"><path d="M0 0 8 4 0 8z"/></marker>'
)

Graph = Mapping[str, set[str]]
Rows = Sequence[Sequence[str]]
Edges = Sequence[tuple[str, str]]


# --- what is drawn, from the code -------------------------------------------------------------


def purpose_of(room: str, root: Path = ROOT) -> str:
    """First line of a room's docstring, without marks and citations.

    Parameters
    ----------
    room : name of its package or module, with dots
    root : folder of the packages

    Raises
    ------
    ValueError : it has no docstring
    """
    path = root / room.replace(".", "/")
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8")))
    if not text:
        raise ValueError(f"{room}: no docstring; write a first line that says what it is for")
    line = text.splitlines()[0].replace("`", "").replace(" -> ", f" {TO} ")
    line = re.sub(r" \((?:ADR|docs/|\w+\.md)[^)]*\)", "", line).removesuffix(".")
    line = re.sub(rf"^(?:The )?{short(room)}: ", "", line, flags=re.IGNORECASE)
    return line[:1].upper() + line[1:]


def imports_of_rooms(tops: Sequence[str] = TOPS) -> dict[str, set[str]]:
    """Direct imports between what stands directly in the top packages."""
    graph = grimp.build_graph(*tops, cache_dir=None)
    rooms: dict[str, set[str]] = {one: set() for top in tops for one in graph.find_children(top)}
    for module in graph.modules:
        room = room_of(module)
        if room in rooms:
            found = {room_of(one) for one in graph.find_modules_directly_imported_by(module)}
            rooms[room] |= (found & rooms.keys()) - {room}
    return rooms


def is_package(room: str) -> bool:
    """Whether a room is a folder."""
    return (ROOT / room.replace(".", "/")).is_dir()


def room_of(module: str) -> str:
    """Package that a module belongs to, two levels deep."""
    return ".".join(module.split(".")[:2])


def short(room: str) -> str:
    """Name of a room within its top package."""
    return room.rpartition(".")[2]


def contract_layers(settings: str, name: str = CONTRACT) -> list[list[str]]:
    """Layers of an import contract, the highest first.

    Parameters
    ----------
    settings : text of pyproject.toml
    name : of the contract

    Raises
    ------
    ValueError : there is no such contract
    """
    for one in tomllib.loads(settings)["tool"]["importlinter"]["contracts"]:
        if one["name"] == name:
            return [re.findall(r"[\w.]+", layer) for layer in one["layers"]]
    raise ValueError(f"pyproject.toml has no import contract {name!r}")


def levels(graph: Graph) -> list[list[str]]:
    """Rooms above what they import; the highest first, each as low as its imports let it be."""
    height: dict[str, int] = {}

    def height_of(room: str) -> int:
        if room not in height:
            height[room] = 1 + max(
                (height_of(one) for one in graph[room] if one in graph), default=-1
            )
        return height[room]

    highest = max(map(height_of, graph), default=-1)
    return [sorted(one for one in graph if height[one] == n) for n in range(highest, -1, -1)]


def reduced(graph: Graph) -> list[tuple[str, str]]:
    """Transitive reduction of imports, sorted: those that do not follow from others."""

    def reached(start: str) -> Iterator[str]:
        for one in graph.get(start, ()):
            yield one
            yield from reached(one)

    below = {room: set(reached(room)) for room in graph}
    return sorted(
        (room, one)
        for room, found in graph.items()
        for one in found
        if one in graph and not any(one in below.get(other, ()) for other in found - {one})
    )


# --- where it is drawn ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Box:
    """A room's place on the page [px], the row it is in, and its lines of text.

    Attributes
    ----------
    row : from the top, 0 for the first
    indent : from its left edge to its text, with room for the name
    """

    x: float
    y: float
    width: float
    height: float
    row: int
    indent: float
    lines: tuple[str, ...]

    @property
    def middle(self) -> float:
        """Its centre from left to right."""
        return self.x + self.width / 2

    @property
    def right(self) -> float:
        """Its right edge."""
        return self.x + self.width

    @property
    def bottom(self) -> float:
        """Its lower edge."""
        return self.y + self.height

    def touches(self, side: float) -> bool:
        """Whether its left or right edge is there."""
        return min(abs(self.x - side), abs(self.right - side)) < 1


def width_of(text: str, size: float = TEXT) -> float:
    """Estimated width of a text [px] in DejaVu Sans, the widest of the usual faces."""
    return size * sum(
        0.37 if one in NARROW else 0.9 if one in WIDE else 0.72 if one.isupper() else 0.61
        for one in text
    )


def wrapped(text: str, width: float) -> tuple[str, ...]:
    """Lines of a text, no wider than asked unless a word is."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and width_of(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return tuple(lines)


def ordered(rows: Rows, edges: Edges) -> Rows:
    """Order of the boxes of each row with which fewest arrows slant or change sides."""

    def cost(order: Sequence[Sequence[str]]) -> int:
        at = {room: (n, k) for n, row in enumerate(order) for k, room in enumerate(row)}
        total = 0
        for one, other in edges:
            (above, k), (below, m) = at[one], at[other]
            is_free = len(order[above]) == 1 or len(order[below]) == 1
            total += 0 if is_free or k == m else min(2, below - above)
        return total

    every: Iterator[Rows] = product(*(tuple(permutations(row)) for row in rows))
    return min(every, key=cost)


def indent_of(rooms: Iterable[str]) -> float:
    """Room for the longest name of a frame, before the text [px]."""
    return max(width_of(short(room), NAME) for room in rooms) + 2 * PAD


def box_of(room: str, words: str, x: float, y: float, width: float, row: int, indent: float) -> Box:
    """Box of a room, as high as its text needs."""
    lines = wrapped(words, width - indent - PAD / 2)
    return Box(x, y, width, ONE_LINE + LINE * (len(lines) - 1), row, indent, lines)


def placed(rows: Rows, x: float, y: float, width: float) -> dict[str, Box]:
    """Boxes of rows of rooms, from the top on."""
    boxes: dict[str, Box] = {}
    indent = indent_of(room for row in rows for room in row)
    for number, row in enumerate(rows):
        each = (width - BESIDE * (len(row) - 1)) / len(row)
        row_boxes = {
            room: box_of(room, purpose_of(room), x + k * (each + BESIDE), y, each, number, indent)
            for k, room in enumerate(row)
        }
        height = max(box.height for box in row_boxes.values())
        boxes |= {room: replace(box, height=height) for room, box in row_boxes.items()}
        y += height + GAP
    return boxes


# --- the drawing ------------------------------------------------------------------------------


def text(x: float, y: float, words: str, kind: str) -> str:
    """Line of text."""
    return f'<text class="{kind}" x="{x:g}" y="{y:g}">{escape(words)}</text>'


def rect(x: float, y: float, width: float, height: float, kind: str) -> str:
    """Box with round corners."""
    size = f'width="{width:g}" height="{height:g}"'
    return f'<rect class="{kind}" x="{x:g}" y="{y:g}" {size} rx="5"/>'


def arrow(*points: tuple[float, float]) -> str:
    """Arrow through points."""
    way = "L".join(f"{x:g} {y:g}" for x, y in points)
    return f'<path class="arrow" d="M{way}" marker-end="url(#tip)"/>'


def room_drawn(room: str, box: Box) -> Iterator[str]:
    """Room: its box, name and purpose."""
    yield rect(box.x, box.y, box.width, box.height, "room")
    yield text(box.x + PAD, box.y + FIRST, short(room), "name")
    for number, line in enumerate(box.lines):
        yield text(box.x + box.indent, box.y + FIRST + LINE * number, line, "text")


def frame_drawn(top: str, x: float, y: float, width: float, end: float) -> Iterator[str]:
    """Frame with the name and purpose of a top package."""
    yield rect(x, y, width, end - y, "frame")
    yield text(x + PAD, y + 20, f"{top}/", "name top")
    for number, line in enumerate(wrapped(purpose_of(top), width - 2 * PAD)):
        yield text(x + PAD, y + 37 + LINE * number, line, "text")


def straight(above: Box, below: Box) -> str:
    """Arrow to the next row: upright where the boxes let it."""
    first, last = max(above.x, below.x), min(above.right, below.right)
    if first < last:
        at = (first + last) / 2
        return arrow((at, above.bottom), (at, below.y))
    begin, end = above.middle - 2 * PAD, below.middle + 2 * PAD  # beside arrows that are upright
    y = above.bottom + GAP / 3
    return arrow((begin, above.bottom), (begin, y), (end, y), (end, below.y))


def around(above: Box, below: Box, side: float, lane: float) -> str:
    """Arrow that passes rows: out at a side of the boxes, down a lane, in again."""

    def ends(box: Box, share: float, beyond: float) -> list[tuple[float, float]]:
        if box.touches(side):
            return [(side, box.y + share * box.height)]
        edge = box.y if beyond < 0 else box.bottom
        return [(box.middle, edge), (box.middle, edge + beyond)]

    leaving, entering = ends(above, 0.7, GAP / 3), ends(below, 0.3, -GAP / 2)[::-1]
    return arrow(*leaving, (lane, leaving[-1][1]), (lane, entering[0][1]), *entering)


def arrows(boxes: Mapping[str, Box], edges: Edges, left: float, right: float) -> Iterator[str]:
    """Arrows between rooms: straight to the next row, else through a gutter beside the rows."""
    pairs = [(boxes[one], boxes[other]) for one, other in edges]
    taken: dict[float, list[tuple[int, int, int]]] = {left: [], right: []}
    for above, below in sorted(pairs, key=lambda two: (two[1].row - two[0].row, two[0].row)):
        if below.row == above.row + 1:
            yield straight(above, below)
            continue
        touching = [one for one in taken if above.touches(one) and below.touches(one)]
        side = min(touching or taken, key=lambda one: len(taken[one]))
        crossed = {n for n, first, last in taken[side] if first < below.row and above.row < last}
        lane = min(set(range(len(crossed) + 1)) - crossed)
        taken[side].append((lane, above.row, below.row))
        yield around(above, below, side, side + LANE * (lane + 1) * (-1 if side == left else 1))


def controller_drawn(graph: Graph, layers: Rows, y: float) -> tuple[list[str], float]:
    """Frame of the controller, and where it ends."""
    inside = {room for row in layers for room in row}
    edges = reduced({room: graph[room] & inside for room in inside})
    left, right = MARGIN + GUTTER, WIDTH - MARGIN - GUTTER
    rows = [layer[n : n + ABREAST] for layer in layers for n in range(0, len(layer), ABREAST)]
    boxes = placed(ordered(rows, edges), left, y + HEAD, right - left)
    drawn = list(arrows(boxes, edges, left, right))
    end = max(box.bottom for box in boxes.values())
    outside = sorted(one for one in graph if one.startswith("controller.") and one not in inside)
    if outside:
        names = ", ".join(f"{short(one)}.py" for one in outside if not is_package(one))
        drawn.append(text(left, end + GAP + FIRST / 2, f"Beside the layers: {names}", "note"))
        indent, y_box = indent_of(boxes), end + GAP + LINE
        for room in filter(is_package, outside):
            box = box_of(room, purpose_of(room), left, y_box, right - left, 0, indent)
            boxes[room], y_box = box, box.bottom + CLOSE
        end = y_box - CLOSE
    for room, box in boxes.items():
        drawn += room_drawn(room, box)
    end += PAD
    return [*frame_drawn("controller", MARGIN, y, WIDTH - 2 * MARGIN, end), *drawn], end


def blocks_of(graph: Graph, paired: Sequence[str]) -> tuple[Rows, Rows]:
    """Rooms above and below the device families that drivers and emulators both have."""
    rest = {room: found for room, found in graph.items() if room not in paired}
    used = {one for found in graph.values() for one in found}
    above = sorted(room for room in rest if room not in used)
    lower = levels({one: rest[one] for one in rest if one in used})
    # what the layer above imports comes first, so that no arrow crosses a room
    for upper, layer in pairwise([list(paired), *lower]):
        layer.sort(key=lambda one: not any(one in graph[room] for room in upper))
    return [above] if above else [], lower


def devices_drawn(graph: Graph, y: float) -> tuple[list[str], float]:
    """Frames of drivers and emulators, device families face to face, and where they end."""
    width = (WIDTH - 2 * MARGIN - BETWEEN) / 2
    sides = {"drivers": MARGIN, "emulators": WIDTH - MARGIN - width}
    own = {
        top: {room: found for room, found in graph.items() if room.startswith(f"{top}.")}
        for top in sides
    }
    rooms = {
        top: {
            room: {one for one in found if one.startswith(f"{top}.") and is_package(one)}
            for room, found in mine.items()
            if is_package(room)
        }
        for top, mine in own.items()
    }
    families = sorted(set.intersection(*({short(one) for one in mine} for mine in rooms.values())))
    paired = {top: [f"{top}.{one}" for one in families] for top in sides}
    blocks = {top: blocks_of(rooms[top], paired[top]) for top in sides}
    drawn: list[str] = []
    boxes: dict[str, Box] = {}
    indent = {top: indent_of(rooms[top]) for top in sides}

    def put(room: str, at: float) -> float:
        top = room.partition(".")[0]
        words = purpose_of(room).partition(": ")[0]
        box = box_of(room, words, sides[top] + PAD, at, width - 2 * PAD, 0, indent[top])
        boxes[room] = box
        return box.bottom

    def stack(every: Rows, at: float) -> float:
        for block in every:
            for room in block:
                at = put(room, at) + CLOSE
            at += GAP - CLOSE
        return at

    start = y + HEAD + LINE
    at = max(stack(blocks[top][0], start) for top in sides)
    for one in families:
        ends = [put(f"{top}.{one}", at) for top in sides]
        for top in sides:
            boxes[f"{top}.{one}"] = replace(boxes[f"{top}.{one}"], height=max(ends) - at)
        middle = (at + max(ends)) / 2
        first, last = boxes[f"drivers.{one}"].right, boxes[f"emulators.{one}"].x
        ends_ = 'marker-start="url(#wire-tip)" marker-end="url(#wire-tip)"'
        drawn.append(f'<path class="wire" d="M{first:g} {middle:g}H{last:g}" {ends_}/>')
        at = max(ends) + CLOSE
    bottoms = {top: stack(blocks[top][1], at + GAP - CLOSE) - GAP for top in sides}
    notes = {
        top: wrapped(
            "Beside them: "
            + ", ".join(
                f"{short(one)}.py"
                for one in sorted(own[top])
                if not is_package(one) and not short(one).startswith("_")
            ),
            width - 2 * PAD,
        )
        for top in sides
    }
    end = max(bottoms[top] + LINE * len(notes[top]) for top in sides) + PAD
    frames: list[str] = []
    for top, x in sides.items():
        frames += frame_drawn(top, x, y, width, end)
        every = [*blocks[top][0], paired[top], *blocks[top][1]]
        for upper, lower in pairwise(every):
            imported = [one for one in lower if any(one in rooms[top][room] for room in upper)]
            if imported:
                drawn.append(straight(boxes[upper[-1]], boxes[imported[0]]))
        for number, line in enumerate(notes[top]):
            drawn.append(text(x + PAD, bottoms[top] + LINE * (number + 1), line, "note"))
    for room, box in boxes.items():
        drawn += room_drawn(room, box)
    return [*frames, *drawn], end


def drawing() -> str:
    """Return docs/pictures/map.svg."""
    graph = imports_of_rooms()
    layers = contract_layers((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    controller, end = controller_drawn(graph, layers, MARGIN)
    devices, height = devices_drawn(graph, end + 2 * GAP)
    users = sorted(
        short(room)
        for room, found in graph.items()
        if room.startswith("controller.") and any(one.startswith("drivers.") for one in found)
    )
    at, wires_at = 2 * MARGIN, WIDTH / 2 + PAD
    height += MARGIN
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" '
            f'width="{WIDTH}" height="{height:g}" role="img" aria-labelledby="title">',
            "<!-- made by `python docs/room_map.py > docs/pictures/map.svg`; do not edit -->",
            '<title id="title">Packages of cellctl and their imports, in layers</title>',
            f"<style>{STYLE}</style>",
            f"<defs>{TIP.format(name='tip')}{TIP.format(name='wire-tip')}</defs>",
            f'<rect class="page" width="{WIDTH}" height="{height:g}"/>',
            *controller,
            *devices,
            arrow((at, end), (at, end + 2 * GAP)),
            *(
                text(at + PAD, end + FIRST - 6 + LINE * number, line, "note")
                for number, line in enumerate(
                    wrapped(f"imported by {', '.join(users)}", wires_at - at - 2 * PAD)
                )
            ),
            text(wires_at, end + GAP + 4, WIRES, "note"),
            "</svg>",
            "",
        ]
    )


if __name__ == "__main__":
    sys.stdout.write(drawing())
