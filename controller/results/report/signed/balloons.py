"""The part as a line drawing from a few sides, with the numbers of its characteristics in balloons.

A side is drawn if characteristics show there: a hole where its axis points at the reader, a
distance where it lies in the paper, from the half of the part that it is in. As few sides as show
them all, at one scale, the largest that the paper has room for. A characteristic that several of
these sides show stands where its leader is shortest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.cad.views import LineView, line_view

from ...line_drawing import Drawing, draw
from ...run import CharacteristicReport
from .leaders import CHAIN_MM, RADIUS_MM, Placed, Ring, arrange

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
# A distance that lies this far beyond the middle of the part, as a share of the part's depth, is
# still shown from this side: with none, featuretype takes a fourth view for what is at its middle.
MIDDLE_SHARE: Final = 0.1
# Of all sides together: the width between the margins of A4, and four fifths of the height, so that
# the table begins below the drawing and a part prints on three pages.
PAPER_MM: Final = (186.0, 217.0)
# Between two sides, and below each for its caption.
SPACE_MM: Final = (3.0, 6.0)
# A part is drawn no larger than this, and its scale is searched for in these steps.
MAX_SCALE, SCALE_STEP = 3.0, 0.95

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Balloon:
    """A number in a balloon, its middle in millimetres of the paper, y downwards."""

    number: int
    at: Point
    verdict: str


@dataclass(frozen=True, slots=True)
class Callout:
    """The measurements at one place: a leader, and the balloons in a chain at its start.

    Attributes
    ----------
    end : of the leader, which begins at the first balloon
    line : both ends of a distance, empty for a hole
    """

    balloons: tuple[Balloon, ...]
    end: Point
    line: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Side:
    """The part from one side, its callouts, and the SVG view box in millimetres of the paper."""

    words: str
    drawing: Drawing
    callouts: tuple[Callout, ...]
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class BalloonDrawing:
    """All sides at one scale, in millimetres of paper for one of the part.

    Attributes
    ----------
    rows : sides beside each other, one row below the other
    radius : of the balloons, in millimetres of the paper
    left_out : balloons with no side to show them
    """

    rows: tuple[tuple[Side, ...], ...]
    scale: float
    radius: float
    left_out: tuple[int, ...]

    @property
    def sides(self) -> tuple[Side, ...]:
        """All sides."""
        return tuple(side for row in self.rows for side in row)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Characteristics measured at one place, and what their leader points at in each view."""

    characteristics: tuple[CharacteristicReport, ...]
    shapes: tuple[BaseGeometry | None, ...]


def balloon_drawing(
    solid: Solid, characteristics: Sequence[CharacteristicReport]
) -> BalloonDrawing:
    """Return the drawing of a part; one without characteristics is drawn from two sides."""
    names = _choose(solid, characteristics) or ["from +z", "from -y"]
    views = [line_view(solid, SIDES[name]) for name in names]
    places = _places(solid, names, views, characteristics)
    shown = {c.balloon for place in places for c in place.characteristics}
    left_out = tuple(c.balloon for c in characteristics if c.balloon not in shown)
    drawings = [draw(view, unit=1.0) for view in views]
    outlines = [np.vstack([loop.points for loop in view.loops]) * (1, -1) for view in views]
    height_mm = PAPER_MM[1]
    while True:
        scale = MAX_SCALE
        while scale > MAX_SCALE / 100:
            rows = _rows(names, drawings, outlines, places, scale)
            if rows is not None and _height(rows) <= height_mm:
                return BalloonDrawing(rows, scale, RADIUS_MM, left_out)
            scale *= SCALE_STEP
        height_mm *= 2  # a part with very many balloons: the drawing goes on over the page


def _choose(solid: Solid, characteristics: Sequence[CharacteristicReport]) -> list[str]:
    """Return the sides to draw: greedily as few as show all characteristics."""
    can: dict[str, set[int]] = {
        name: {c.balloon for c in characteristics if _shows(solid, c, R)}
        for name, R in SIDES.items()
    }
    open_ = set().union(*can.values())
    chosen: list[str] = []
    while open_:
        best = max(can, key=lambda name: len(can[name] & open_))
        open_ -= can[best]
        chosen.append(best)
    return chosen


def _shows(solid: Solid, c: CharacteristicReport, R: FloatArray) -> bool:
    """Return whether a side shows a characteristic: a distance, from the half it lies in."""
    if not c.anchors_mm:
        return False
    if c.axis is None:
        return True
    along = float(np.asarray(c.axis) @ R[2])
    if c.rim_radius_mm is not None:
        return bool(along > np.cos(MAX_OFF_RAD))
    low, high = solid.mesh.bounds
    towards_mm = (np.mean(c.anchors_mm, axis=0) - (low + high) / 2) @ R[2]
    depth_mm = (high - low) @ np.abs(R[2])
    return bool(abs(along) < np.sin(MAX_OFF_RAD) and towards_mm > -MIDDLE_SHARE * depth_mm)


def _places(
    solid: Solid,
    names: Sequence[str],
    views: Sequence[LineView],
    characteristics: Sequence[CharacteristicReport],
) -> list[_Place]:
    """Return the measurements grouped by place, in the order of the balloons."""
    together: dict[tuple[object, ...], list[CharacteristicReport]] = {}
    for c in characteristics:
        if any(_shows(solid, c, SIDES[name]) for name in names):
            together.setdefault((c.anchors_mm, c.axis, c.rim_radius_mm), []).append(c)
    return [
        _Place(
            tuple(group),
            tuple(
                _shape(solid, group[0], SIDES[name], view)
                if _shows(solid, group[0], SIDES[name])
                else None
                for name, view in zip(names, views, strict=True)
            ),
        )
        for group in together.values()
    ]


def _shape(solid: Solid, c: CharacteristicReport, R: FloatArray, view: LineView) -> BaseGeometry:
    """Return the target of a leader [mm of the part, y downwards]: a rim, a face, a distance."""
    anchors = _flat(np.array(c.anchors_mm), R, solid)
    if c.kind == "radius":  # an arc's centre is off the part: its own face is pointed at
        is_of = np.isin(solid.face_of_triangle, c.faces)
        if is_of.any():
            corners = np.unique(np.asarray(solid.mesh.faces)[is_of])
            return shapely.MultiPoint(_flat(np.asarray(solid.mesh.vertices)[corners], R, solid))
    if c.rim_radius_mm is not None:
        return shapely.Point(anchors[0]).buffer(c.rim_radius_mm, quad_segs=16).exterior
    if len(anchors) < 2:
        return shapely.Point(anchors[0])
    return _distance(anchors, c.axis, R, view)


def _distance(
    anchors: FloatArray, axis: Sequence[float] | None, R: FloatArray, view: LineView
) -> BaseGeometry:
    """Return a distance as a line along its axis, through the anchor nearer to the outline."""
    first, last = anchors[0], anchors[-1]
    if axis is None:
        return shapely.LineString([first, last])
    way = (np.asarray(axis) @ R[:2].T) * (1, -1)
    way /= np.linalg.norm(way)
    lines = [
        shapely.LineString([at, at + sign * ((last - first) @ way) * way])
        for at, sign in ((first, 1), (last, -1))
    ]
    outline = np.vstack([loop.points for loop in view.loops]) * (1, -1)
    hull = shapely.MultiPoint(outline).convex_hull.boundary
    return min(lines, key=lambda line: float(shapely.distance(line.centroid, hull)))


def _flat(points_mm: FloatArray, R: FloatArray, solid: Solid) -> FloatArray:
    flat: FloatArray = (points_mm - solid.centroid_mm) @ R[:2].T * (1, -1)
    return flat


def _rows(
    names: Sequence[str],
    drawings: Sequence[Drawing],
    outlines: Sequence[FloatArray],
    places: Sequence[_Place],
    scale: float,
) -> tuple[tuple[Side, ...], ...] | None:
    """Return all sides at a scale, in rows; None if they or their balloons find no room."""
    targets = [
        [None if s is None else shapely.transform(s, lambda xy: scale * xy) for s in place.shapes]
        for place in places
    ]
    rings = []
    for i, outline in enumerate(outlines):  # a distance may reach beyond the part
        shown = [shape for row in targets if (shape := row[i]) is not None]
        rings.append(Ring.about(np.vstack([scale * outline, shapely.get_coordinates(shown)])))
    placed = arrange(rings, targets)
    if placed is None:
        return None
    sides = []
    for i, name in enumerate(names):
        callouts = tuple(
            _callout(place, one, targets[k][i])
            for k, (place, one) in enumerate(zip(places, placed, strict=True))
            if one.view == i
        )
        sides.append(_side(name, drawings[i], scale * outlines[i], callouts))
    rows: list[list[Side]] = []
    for side in sides:
        if side.width > PAPER_MM[0]:
            return None
        for row in rows:
            if _width(row) + SPACE_MM[0] + side.width <= PAPER_MM[0]:
                row.append(side)
                break
        else:
            rows.append([side])
    return tuple(tuple(row) for row in rows)


def _width(row: Sequence[Side]) -> float:
    return sum(side.width for side in row) + SPACE_MM[0] * (len(row) - 1)


def _height(rows: Sequence[Sequence[Side]]) -> float:
    return sum(max(side.height for side in row) + SPACE_MM[1] for row in rows)


def _callout(place: _Place, placed: Placed, shape: BaseGeometry | None) -> Callout:
    balloons = tuple(
        Balloon(c.balloon, _point(placed.start + i * CHAIN_MM * placed.outward), c.verdict)
        for i, c in enumerate(place.characteristics)
    )
    is_distance = isinstance(shape, shapely.LineString) and not shape.is_closed
    line = shapely.get_coordinates(shape) if is_distance else ()
    return Callout(balloons, _point(placed.end), tuple(_point(p) for p in line))


def _side(name: str, drawing: Drawing, outline: FloatArray, callouts: tuple[Callout, ...]) -> Side:
    middles = [b.at for callout in callouts for b in callout.balloons]
    room = RADIUS_MM + 0.3
    corners = np.vstack(
        [outline, *(np.array(at) + sign * room for at in middles for sign in (-1, 1))]
    )
    low, high = corners.min(axis=0) - 0.3, corners.max(axis=0) + 0.3
    width, height = (float(v) for v in high - low)
    return Side(name, drawing, callouts, float(low[0]), float(low[1]), width, height)


def _point(xy: FloatArray) -> Point:
    return float(xy[0]), float(xy[1])
