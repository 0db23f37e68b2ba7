"""Line drawing of the part from a few sides, with its characteristics numbered in balloons.

A side is drawn if it shows characteristics: a hole whose axis points at the reader, or a distance
in the plane of the paper and in the nearer half of the part. The drawing has as few sides as show
all characteristics, at the largest common scale that fits the paper. A characteristic shown by
several sides is placed where its leader is shortest. Where several long leaders end close together,
the place is repeated as a detail, if this reduces the scale of the sides only slightly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.cad.views import LineView, line_view
from controller.cell.journal.rows import CharacteristicFields

from ...line_drawing import Drawing, draw
from .leaders import CHAIN_MM, GAP_MM, RADIUS_MM, BalloonRing, PlacedLeader, arrange

# Rows are the directions right, up and towards the reader, in the CAD frame.
SIDES: Final[Mapping[str, FloatArray]] = {
    "from +z": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "from -z": np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]]),
    "from -y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "from +y": np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]]),
    "from +x": np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]]),
    "from -x": np.array([[0, -1.0, 0], [0, 0, 1], [-1, 0, 0]]),
}
# Largest angle of a hole's axis to the direction of the reader, or of a distance to the paper.
MAX_OFF_RAD: Final = float(np.radians(30.0))
# Depth beyond the middle of the part, as a share of the part's depth, to which a side shows
# distances. With 0, featuretype needs a fourth view for the distances at its middle.
MIDDLE_SHARE: Final = 0.1
# Size of all sides together: the width between the margins of A4, and four fifths of the height, so
# that the table begins below the drawing and a part prints on three pages.
PAPER_MM: Final = (186.0, 217.0)
# Space between two sides, and below each for its caption.
SPACE_MM: Final = (3.0, 6.0)
# Largest and smallest scale of a drawing, and the factor between the scales tried.
MAX_SCALE, MIN_SCALE, SCALE_STEP = 3.0, 0.03, 0.95
# Length above which a leader crosses other features; a shorter one is as good as a detail.
LONG_MM: Final = 2.0 * GAP_MM
# Radius of the circle on the side that contains the targets of a detail's balloons, and the margin
# with which it is drawn. The detail's own circle is at least twice as wide.
CROWD_RADIUS_MM, DETAIL_MARGIN_MM = 10.5, 1.5
DETAIL_RADIUS_MM: Final = 2.0 * (CROWD_RADIUS_MM + DETAIL_MARGIN_MM)
# Least number of balloons in a detail, and largest number of details in a drawing.
MIN_CROWD, MAX_DETAILS = 4, 3
MAX_ENLARGED: Final = 4.0  # largest scale of a detail, in that of its side
# Least share of their scale that sides keep where details take room from them.
MIN_SIDE_SHARE: Final = 0.8

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Balloon:
    """A numbered balloon, with its centre in millimetres of the paper, y downwards."""

    number: int
    at: Point
    verdict: str


@dataclass(frozen=True, slots=True)
class Callout:
    """The measurements at one place: a leader, and a chain of balloons at its start.

    Attributes
    ----------
    end : end of the leader, which begins at the first balloon
    line : both ends of a distance; empty for a hole
    """

    balloons: tuple[Balloon, ...]
    end: Point
    line: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Circle:
    """Border of a detail, in millimetres of the paper, and the detail's letter."""

    letter: str
    at: Point
    radius: float


@dataclass(frozen=True, slots=True)
class DrawingSide:
    """The part from one side, or a detail of it, with the SVG view box in mm of the paper.

    Attributes
    ----------
    words : name of the view
    scale : scale of this view
    border : border of a detail; None for a whole side
    marks : borders of this side's details
    """

    words: str
    drawing: Drawing
    scale: float
    callouts: tuple[Callout, ...]
    x: float
    y: float
    width: float
    height: float
    border: Circle | None = None
    marks: tuple[Circle, ...] = ()


@dataclass(frozen=True, slots=True)
class BalloonDrawing:
    """All sides at one scale, in millimetres of paper per millimetre of the part.

    Attributes
    ----------
    rows : sides and details side by side, row by row
    scale : scale of the sides
    radius : radius of the balloons, in millimetres of the paper
    left_out : balloons that no side shows
    """

    rows: tuple[tuple[DrawingSide, ...], ...]
    scale: float
    radius: float
    left_out: tuple[int, ...]

    @property
    def sides(self) -> tuple[DrawingSide, ...]:
        """All sides."""
        return tuple(side for row in self.rows for side in row)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Characteristics measured at one place, and the target of their leader in each view."""

    characteristics: tuple[CharacteristicFields, ...]
    shapes: tuple[BaseGeometry | None, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """A side, or a detail of one; lengths are of the part.

    Attributes
    ----------
    outline : points (n, 2) around which balloons are placed
    enlarged : scale relative to the sides
    side : number of the side to which a detail belongs; None for a side
    """

    words: str
    drawing: Drawing
    outline: FloatArray
    enlarged: float = 1.0
    side: int | None = None
    letter: str = ""
    at: Point = (0.0, 0.0)
    radius: float = 0.0


def balloon_drawing(
    solid: Solid, characteristics: Sequence[CharacteristicFields]
) -> BalloonDrawing:
    """Return the drawing of a part; one without characteristics is drawn from two sides."""
    names = _choose(solid, characteristics) or ["from +z", "from -y"]
    views = [line_view(solid, SIDES[name]) for name in names]
    places = _places(solid, names, views, characteristics)
    shown = {c.balloon for place in places for c in place.characteristics}
    left_out = tuple(c.balloon for c in characteristics if c.balloon not in shown)
    whole = [
        _View(name, draw(view, unit=1.0), np.vstack([loop.points for loop in view.loops]) * (1, -1))
        for name, view in zip(names, views, strict=True)
    ]
    height_mm = PAPER_MM[1]
    while True:
        fitting = _fitting(whole, places, MAX_SCALE, MIN_SCALE, height_mm)
        if fitting is not None:
            rows, scale = _detailed(whole, places, *fitting, height_mm)
            return BalloonDrawing(rows, scale, RADIUS_MM, left_out)
        height_mm *= 2  # with very many balloons, the drawing continues on the next page


def _choose(solid: Solid, characteristics: Sequence[CharacteristicFields]) -> list[str]:
    """Return the sides to draw, chosen greedily: as few as show all characteristics."""
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


def _shows(solid: Solid, c: CharacteristicFields, R: FloatArray) -> bool:
    """Return True if a side shows a characteristic; a distance must be in the nearer half."""
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
    characteristics: Sequence[CharacteristicFields],
) -> list[_Place]:
    """Return the measurements grouped by place, in the order of the balloons."""
    together: dict[tuple[object, ...], list[CharacteristicFields]] = {}
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


def _shape(solid: Solid, c: CharacteristicFields, R: FloatArray, view: LineView) -> BaseGeometry:
    """Return the target of a leader [mm of the part, y downwards]: rim, face or distance."""
    anchors = _flat(np.array(c.anchors_mm), R, solid)
    if c.kind == "radius":  # the leader points at the arc's face, since the centre is off the part
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
    """Return a distance as a line along its axis through the anchor nearer to the outline."""
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


def _detailed(
    whole: Sequence[_View],
    places: Sequence[_Place],
    sides: tuple[DrawingSide, ...],
    rows: tuple[tuple[DrawingSide, ...], ...],
    scale: float,
    height_mm: float,
) -> tuple[tuple[tuple[DrawingSide, ...], ...], float]:
    """Return the rows with as many details as fit, and the scale of the sides."""
    views, placed = list(whole), list(places)
    least = MIN_SIDE_SHARE * scale
    for letter in "ABCDEFGH"[:MAX_DETAILS]:
        crowd = _crowd(places, sides, scale)
        if crowd is None:
            break
        i, members, at, radius_mm = crowd
        circle = shapely.get_coordinates(shapely.Point(at).buffer(radius_mm, quad_segs=16))
        enlarged = min(MAX_ENLARGED, DETAIL_RADIUS_MM / (radius_mm * scale))
        views.append(
            _View(f"detail {letter}", whole[i].drawing, circle, enlarged, i, letter, at, radius_mm)
        )
        hidden = (None,) * (len(views) - 1)
        placed = [
            replace(place, shapes=(*hidden, places[k].shapes[i]) if k in members
                    else (*place.shapes, None))
            for k, place in enumerate(placed)
        ]  # fmt: skip
        fitting = _fitting(views, placed, scale, least, height_mm)
        if fitting is None:
            break
        sides, rows, scale = fitting
    return rows, scale


def _fitting(
    views: Sequence[_View],
    places: Sequence[_Place],
    scale: float,
    least: float,
    height_mm: float,
) -> tuple[tuple[DrawingSide, ...], tuple[tuple[DrawingSide, ...], ...], float] | None:
    """Return views, rows and scale: the largest scale from `scale` down to `least` that fits."""
    while scale >= least:
        sides = _sides(views, places, scale)
        rows = None if sides is None else _rows(sides)
        if sides is not None and rows is not None and _height(rows) <= height_mm:
            return sides, rows, scale
        scale *= SCALE_STEP
    return None


def _crowd(
    places: Sequence[_Place], sides: Sequence[DrawingSide], scale: float
) -> tuple[int, frozenset[int], Point, float] | None:
    """Return the place in a side at which most long leaders end; None if there is no crowd.

    The result is its side, the places in it, and its circle [mm of the part].
    """
    number_of = {c.balloon: k for k, place in enumerate(places) for c in place.characteristics}
    best: tuple[int, frozenset[int], Point, float] | None = None
    for i, side in enumerate(sides):
        far = [
            number_of[callout.balloons[0].number]
            for callout in side.callouts
            if side.border is None and _length(callout) > LONG_MM
        ]
        shapes = {k: _scaled(s, scale) for k in far if (s := places[k].shapes[i]) is not None}
        for one, another in combinations_with_replacement(shapes.values(), 2):
            middle = shapely.LineString([one.centroid, another.centroid]).centroid
            around = middle.buffer(CROWD_RADIUS_MM)
            members = frozenset(k for k, other in shapes.items() if around.contains(other))
            if len(members) < (MIN_CROWD if best is None else len(best[1]) + 1):
                continue
            bound = shapely.minimum_bounding_circle(
                shapely.union_all([shapes[k] for k in sorted(members)])
            ).buffer(DETAIL_MARGIN_MM)
            if all(bound.disjoint(shapely.Point(m.at).buffer(m.radius)) for m in side.marks):
                at = shapely.get_coordinates(bound.centroid)[0] / scale
                radius_mm = float(shapely.minimum_bounding_radius(bound)) / scale
                best = (i, members, _point(at), radius_mm)
    return best


def _length(callout: Callout) -> float:
    return float(np.hypot(*np.subtract(callout.balloons[0].at, callout.end)))


def _sides(
    views: Sequence[_View], places: Sequence[_Place], scale: float
) -> tuple[DrawingSide, ...] | None:
    """Return all views at a scale of the sides; None if their balloons do not fit."""
    factors = [scale * view.enlarged for view in views]
    targets = [
        [
            None if shape is None else _scaled(shape, factor)
            for shape, factor in zip(place.shapes, factors, strict=True)
        ]
        for place in places
    ]
    rings = []
    for i, (view, factor) in enumerate(zip(views, factors, strict=True)):
        # A distance may extend beyond the part.
        shown = [shape for row in targets if (shape := row[i]) is not None]
        rings.append(
            BalloonRing.about(np.vstack([factor * view.outline, shapely.get_coordinates(shown)]))
        )
    arranged = arrange(rings, targets)
    if arranged is None:
        return None
    return tuple(
        _side(
            views,
            i,
            scale,
            tuple(
                _callout(place, one, targets[k][i])
                for k, (place, one) in enumerate(zip(places, arranged, strict=True))
                if one.view == i
            ),
        )
        for i in range(len(views))
    )


def _scaled(shape: BaseGeometry, factor: float) -> BaseGeometry:
    return shapely.transform(shape, lambda xy: factor * xy)


def _rows(sides: Sequence[DrawingSide]) -> tuple[tuple[DrawingSide, ...], ...] | None:
    """Return sides and details in rows; None if one of them is wider than the paper."""
    rows: list[list[DrawingSide]] = []
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


def _width(row: Sequence[DrawingSide]) -> float:
    return sum(side.width for side in row) + SPACE_MM[0] * (len(row) - 1)


def _height(rows: Sequence[Sequence[DrawingSide]]) -> float:
    return sum(max(side.height for side in row) + SPACE_MM[1] for row in rows)


def _callout(place: _Place, placed: PlacedLeader, shape: BaseGeometry | None) -> Callout:
    balloons = tuple(
        Balloon(c.balloon, _point(placed.start + i * CHAIN_MM * placed.outward), c.verdict)
        for i, c in enumerate(place.characteristics)
    )
    is_distance = isinstance(shape, shapely.LineString) and not shape.is_closed
    line = shapely.get_coordinates(shape) if is_distance else ()
    return Callout(balloons, _point(placed.end), tuple(_point(p) for p in line))


def _side(
    views: Sequence[_View], i: int, scale: float, callouts: tuple[Callout, ...]
) -> DrawingSide:
    view = views[i]
    factor = scale * view.enlarged
    middles = [b.at for callout in callouts for b in callout.balloons]
    room = RADIUS_MM + 0.3
    corners = np.vstack(
        [factor * view.outline, *(np.array(at) + sign * room for at in middles for sign in (-1, 1))]
    )
    low, high = corners.min(axis=0) - 0.3, corners.max(axis=0) + 0.3
    width, height = (float(v) for v in high - low)
    return DrawingSide(
        view.words,
        view.drawing,
        factor,
        callouts,
        float(low[0]),
        float(low[1]),
        width,
        height,
        border=None if view.side is None else _circle(view, factor),
        marks=tuple(_circle(other, factor) for other in views if other.side == i),
    )


def _circle(view: _View, factor: float) -> Circle:
    return Circle(view.letter, _point(factor * np.array(view.at)), factor * view.radius)


def _point(xy: FloatArray) -> Point:
    return float(xy[0]), float(xy[1])
