"""The part as a line drawing from a few sides, with the numbers of its characteristics in balloons.

A side is drawn if characteristics show there: a hole where its axis points at the reader, a
distance where it lies in the paper. As few sides as show them all, at one scale. Balloons stand in
a column on either side of the part, in the order of what they point at, so that no two leaders
cross on their way there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.cad.views import LineView, line_view

from ...line_drawing import Drawing, DrawingFrame, draw, frame_of
from ...run import CharacteristicReport

# rows are right, up and towards the reader, in the CAD frame
SIDES: Final[Mapping[str, FloatArray]] = {
    "from +z": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "from -z": np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]]),
    "from -y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "from +y": np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]]),
    "from +x": np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]]),
    "from -x": np.array([[0, -1.0, 0], [0, 0, 1], [-1, 0, 0]]),
}
# a hole's axis within this of the reader's direction, or a distance within it of the paper
MAX_OFF_RAD: Final = float(np.radians(30.0))
# of balloons, in hundredths of the drawing's larger side
RADIUS_UNITS: Final = 2.6
PITCH_UNITS: Final = 6.0
CHAIN_UNITS: Final = 5.6
GAP_UNITS: Final = 7.0
MAX_SIDES: Final = 4
# of all sides together, on paper
PAPER_MM: Final = (186.0, 105.0)
GAP_MM: Final = 4.0
MAX_SCALE: Final = 3.0

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Balloon:
    """A number and the point it marks, in the drawing's coordinates (y downwards).

    Attributes
    ----------
    at, end : middle of the balloon, and the end of its leader
    marks : both ends of a distance, empty for a hole
    verdict : of its characteristic
    has_leader : False for those that hang on another balloon of the same place
    """

    number: int
    at: Point
    end: Point
    marks: tuple[Point, ...]
    verdict: str
    has_leader: bool


@dataclass(frozen=True, slots=True)
class Side:
    """The part from one side, with its balloons; `view_box` is that of the SVG element."""

    words: str
    drawing: Drawing
    balloons: tuple[Balloon, ...]
    view_box: str
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class BalloonDrawing:
    """All sides at one scale, in millimetres of paper for one of the part.

    Attributes
    ----------
    unit, radius : size of letters and of balloons [mm of the part]
    left_out : balloons with no side to show them
    """

    sides: tuple[Side, ...]
    unit: float
    radius: float
    bar_mm: float
    scale: float
    left_out: tuple[int, ...]


def balloon_drawing(
    solid: Solid, characteristics: Sequence[CharacteristicReport]
) -> BalloonDrawing:
    """Return the drawing of a part; one without characteristics is drawn from two sides."""
    shown_at = _choose(characteristics)
    names = list(dict.fromkeys(shown_at.values())) or ["from +z", "from -y"]
    views = {name: line_view(solid, SIDES[name]) for name in names}
    frame = frame_of(tuple(views.values()))
    sides = tuple(
        _side(
            name,
            view,
            frame,
            solid.centroid_mm,
            [c for c in characteristics if shown_at.get(c.balloon) == name],
        )
        for name, view in views.items()
    )
    left_out = tuple(c.balloon for c in characteristics if c.balloon not in shown_at)
    return BalloonDrawing(
        sides, frame.unit, RADIUS_UNITS * frame.unit, frame.bar_mm, _scale(sides), left_out
    )


def _choose(characteristics: Sequence[CharacteristicReport]) -> dict[int, str]:
    """Return the side each balloon is drawn at: greedily as few sides as show them all."""
    can: dict[str, set[int]] = {
        name: {c.balloon for c in characteristics if _shows(c, R)} for name, R in SIDES.items()
    }
    open_ = set().union(*can.values())
    chosen: dict[int, str] = {}
    while open_ and len(set(chosen.values())) < MAX_SIDES:
        best = max(can, key=lambda name: len(can[name] & open_))
        if not can[best] & open_:
            break
        chosen |= dict.fromkeys(sorted(can[best] & open_), best)
        open_ -= can[best]
    return chosen


def _shows(c: CharacteristicReport, R: FloatArray) -> bool:
    if not c.anchors_mm:
        return False
    if c.axis is None:
        return True
    along = float(np.asarray(c.axis) @ R[2])
    if c.rim_radius_mm is not None:
        return bool(along > np.cos(MAX_OFF_RAD))
    return bool(abs(along) < np.sin(MAX_OFF_RAD))


def _side(
    name: str,
    view: LineView,
    frame: DrawingFrame,
    centroid_mm: FloatArray,
    characteristics: Sequence[CharacteristicReport],
) -> Side:
    R, unit = SIDES[name], frame.unit
    points = np.vstack([loop.points for loop in view.loops])
    low, high = points.min(axis=0), points.max(axis=0)
    on_paper = {
        c.balloon: [(float(x), float(-y)) for x, y in _flat(c, R, centroid_mm)]
        for c in characteristics
    }
    ends = {
        number: (sum(x for x, _ in at) / len(at), sum(y for _, y in at) / len(at))
        for number, at in on_paper.items()
    }
    # what is measured at one place has one leader, its balloons in a chain
    places: dict[Point, list[int]] = {}
    for number, (x, y) in ends.items():
        places.setdefault((round(x / unit), round(y / unit)), []).append(number)
    groups = list(places.values())
    middle_x = float(low[0] + high[0]) / 2
    middle_y = float(-(low[1] + high[1])) / 2
    groups.sort(key=lambda group: ends[group[0]][0])
    half = (len(groups) + 1) // 2
    left = [g for g in groups if ends[g[0]][0] < middle_x][:half]
    left += [g for g in groups if g not in left][: max(0, len(groups) - half - len(left))]
    at: dict[int, Point] = {}
    for side, column in ((-1.0, left), (1.0, [g for g in groups if g not in left])):
        column.sort(key=lambda group: ends[group[0]][1])
        heights = _apart([ends[g[0]][1] for g in column], PITCH_UNITS * unit, middle_y)
        x0 = float(low[0] if side < 0 else high[0]) + side * GAP_UNITS * unit
        for group, height in zip(column, heights, strict=True):
            for i, number in enumerate(group):
                at[number] = (x0 + side * i * CHAIN_UNITS * unit, height)
    first = {group[0] for group in groups}
    balloons = tuple(
        Balloon(
            c.balloon,
            at[c.balloon],
            ends[c.balloon],
            tuple(on_paper[c.balloon]) if len(on_paper[c.balloon]) > 1 else (),
            c.verdict,
            c.balloon in first,
        )
        for c in characteristics
    )
    room = (RADIUS_UNITS + 1) * unit
    xs = [float(low[0]), float(high[0]), *(x for x, _ in at.values())]
    ys = [float(-high[1]), float(-low[1]), *(y for _, y in at.values())]
    x0, y0 = min(xs) - room, min(ys) - room
    width, height = max(xs) + room - x0, max(ys) + room - y0
    return Side(
        name,
        draw(view, unit),
        balloons,
        f"{x0:.2f} {y0:.2f} {width:.2f} {height:.2f}",
        width,
        height,
    )


def _flat(c: CharacteristicReport, R: FloatArray, centroid_mm: FloatArray) -> FloatArray:
    flat: FloatArray = (np.array(c.anchors_mm) - centroid_mm) @ R[:2].T
    return flat


def _apart(wanted: Sequence[float], pitch: float, middle: float) -> list[float]:
    """Return heights in the same order, near those wanted and at least a pitch apart."""
    if not wanted:
        return []
    heights = list(wanted)
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + pitch)
    # what was pushed down stands about what it points at again
    shift = sum(w - h for w, h in zip(wanted, heights, strict=True)) / len(heights)
    heights = [h + shift for h in heights]
    spread = (len(heights) - 1) * pitch
    if heights[-1] - heights[0] <= spread * 1.001:
        heights = [middle - spread / 2 + i * pitch for i in range(len(heights))]
    return heights


def _scale(sides: Sequence[Side]) -> float:
    """Return the largest scale at which all sides, one after the other in rows, fit the paper."""
    wide, high = PAPER_MM
    scale = MAX_SCALE
    while scale > 0.01:
        row_width = row_height = total = 0.0
        for side in sides:
            width, height = side.width * scale + GAP_MM, side.height * scale + GAP_MM
            if row_width and row_width + width > wide:
                total, row_width, row_height = total + row_height, 0.0, 0.0
            row_width, row_height = row_width + width, max(row_height, height)
        fits = max(side.width for side in sides) * scale + GAP_MM <= wide
        if fits and total + row_height <= high:
            break
        scale *= 0.97
    return scale
