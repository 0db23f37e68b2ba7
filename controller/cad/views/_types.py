"""Views: an outline in loops, and the visible edges, as lines and arcs.

Coordinates of a view are those of its plane. Orthographic, seen from above: mm, x right and y up,
the centre of mass at the origin. Through a calibrated camera: pixels, u right and v down, lens
distortion included. "Anticlockwise" is what the eye sees, so that through a camera the signed
shoelace sum in (u, v) is negative for an outer loop.
"""

from dataclasses import dataclass
from typing import Literal

from controller.arrays import BoolArray, FloatArray, Int32Array

LineKind = Literal["sharp", "smooth", "silhouette"]


@dataclass(frozen=True, eq=False, slots=True)
class Stroke:
    """A straight line or an arc of an outline or an edge.

    Attributes
    ----------
    start, end : (2,)
    centre : (2,) centre of the ellipse an arc is part of; None for a straight line
    axes : (2, 2) the ellipse's half axes as rows, of equal length for a circle; None for a line
    sweep_rad : turned through from start to end in the ellipse's own angle, 0 for a line; its
        sign is that of a turn from the first half axis towards the second
    edge : CAD edge it is of, -1 where it is the silhouette of a curved face
    face : curved face of a silhouette; -1 otherwise
    """

    start: FloatArray
    end: FloatArray
    centre: FloatArray | None
    axes: FloatArray | None
    sweep_rad: float
    edge: int
    face: int


@dataclass(frozen=True, eq=False, slots=True)
class Loop:
    """A closed run of an outline.

    Attributes
    ----------
    points : (n, 2) corners of its polygon, the first not repeated; anticlockwise to the eye where
        it bounds the part from outside, clockwise round a hole
    edges : (n,) CAD edge of the side from point i to the next, -1 for the silhouette of a curve
    faces : (n,) curved face of such a side, -1 otherwise
    is_phantom : (n,) True where the point is no corner of the part, but where one edge passes
        behind another
    is_hole : whether light is seen through it
    strokes : the same loop as lines and arcs
    """

    points: FloatArray
    edges: Int32Array
    faces: Int32Array
    is_phantom: BoolArray
    is_hole: bool
    strokes: tuple[Stroke, ...]


@dataclass(frozen=True, eq=False, slots=True)
class DrawnEdge:
    """A visible run of an edge.

    Attributes
    ----------
    points : (n, 2) polyline
    points_mm : (n, 3) the same in the CAD frame
    edge : CAD edge, -1 where it is the silhouette of a curved face
    face : curved face of a silhouette; -1 otherwise
    kind : type of the edge: a crease, a smooth join of two faces, or the rim of a curved face. A
        smooth join is such a rim too where the part turns away along it; then ``edge`` is set
    on_outline : part of the occluding boundary
    starts_phantom, ends_phantom : its end is no corner of the part, but where it passes behind
    """

    points: FloatArray
    points_mm: FloatArray
    edge: int
    face: int
    kind: LineKind
    on_outline: bool
    starts_phantom: bool
    ends_phantom: bool


@dataclass(frozen=True, eq=False, slots=True)
class LineView:
    """A part as a line drawing.

    Attributes
    ----------
    loops : loops of the occluding boundary, outer loops first, the largest one before all
    edges : visible edges, hidden parts removed, doubled lines merged
    area, perimeter : area and perimeter of the outline, holes taken out and counted in
    centroid : (2,) centroid of the filled outline
    second_moments : (2, 2) second moments of the filled outline about its centroid, divided by its
        area
    """

    loops: tuple[Loop, ...]
    edges: tuple[DrawnEdge, ...]
    area: float
    perimeter: float
    centroid: FloatArray
    second_moments: FloatArray
