"""Edges of a part as curves in space, with the origins and directions of rays."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, IndexArray, median
from controller.cad import Solid

from ..characteristics import EdgeLine, Rim, rim_directions
from ..characteristics.edges.rims import FULL_RAD
from ..limits import CORNER_PX

SPACING_PX: Final = 1.0  # distance between rays; closer ones use the same pixels
MAX_RAYS: Final = 120
MIN_RAYS: Final = 16
SAME_RAD: Final = 1e-4  # angle between points below which they coincide
MIN_CHORDS: Final = 3  # least number of chord ends that determine a circle
WIDEST_RAD: Final = 0.5  # largest half angle that a chord spans
# Number of tested turns of a mesh, in equal shares of a chord. A part that looks the same from four
# sides may be held in any of these orientations, which displaces its chords. With six turns, at
# least cos(30 degrees) of the chords' height is detected.
TURN_COUNT: Final = 6
NEIGHBOUR: Final = 0.02  # step along a curve for tangent and bend, as a share of its length


@dataclass(frozen=True, eq=False, slots=True)
class Chords:
    """A rim in the mesh: chords between points on it.

    Attributes
    ----------
    angles_rad : (n,) ascending angles of the points about the axis, from the rim's start
    radii_mm : (n,) their distances from the axis
    height_mm : height of the median chord
    """

    angles_rad: FloatArray
    radii_mm: FloatArray
    height_mm: float

    def depth_mm(self, at_rad: FloatArray, radius_mm: float) -> FloatArray:
        """Return the depth of the mesh's edge inside the circle at angles (n,) [mm].

        Parameters
        ----------
        at_rad : (n,) angles about the axis, from the rim's start
        radius_mm : radius of the circle
        """
        count = len(self.angles_rad)
        if count < MIN_CHORDS:
            return np.zeros(len(at_rad))
        turn = 2 * np.pi
        at = np.mod(at_rad - self.angles_rad[0], turn) + self.angles_rad[0]
        after = np.searchsorted(self.angles_rad, at, side="right")
        low = self.angles_rad[after - 1]
        high = np.where(after < count, self.angles_rad[after % count], self.angles_rad[0] + turn)
        one, other = self.radii_mm[after - 1], self.radii_mm[after % count]
        # Point at which the chord crosses the ray at this angle.
        across = one * np.sin(at - low) + other * np.sin(high - at)
        along = one * other * np.sin(high - low) / np.maximum(across, 1e-12)
        # A wider gap is an end of the rim, not a chord.
        return np.asarray(np.where(high - low < 2 * WIDEST_RAD, radius_mm - along, 0.0))

    def turned_mm(self, at_rad: FloatArray, radius_mm: float, sense: float) -> FloatArray:
        """Return the same (n, `TURN_COUNT`) for the mesh turned by shares of its median chord.

        Parameters
        ----------
        at_rad, radius_mm : see `depth_mm`
        sense : sense of the turn about the axis, 1 or -1
        """
        chord_rad = median(np.diff(self.angles_rad)) if len(self.angles_rad) > 1 else 0.0
        turns = np.arange(TURN_COUNT) * (sense * chord_rad / TURN_COUNT)
        return np.stack([self.depth_mm(at_rad + turn, radius_mm) for turn in turns], axis=1)


@dataclass(frozen=True, eq=False, slots=True)
class Curve:
    """Points of one edge, CAD frame.

    Attributes
    ----------
    before_mm, points_mm, after_mm : (n, 3) points, and others slightly before and after them
    shift : (n, 3) unit, positive direction of an offset
    out : (n, 3) unit, out of the material
    design : (n, p, 3) derivatives of the points by the unknowns of the feature [mm]
    facet_mm : largest distance of the mesh from the curve
    outward : 1 where the shift leads out of the material, -1 into it
    chord_mm : (n, `TURN_COUNT`, 3) vectors from a point to the mesh's own edge, also with the mesh
        turned about the edge's axis by shares of a chord
    """

    before_mm: FloatArray
    points_mm: FloatArray
    after_mm: FloatArray
    shift: FloatArray
    out: FloatArray
    design: FloatArray
    facet_mm: float
    outward: float
    chord_mm: FloatArray

    def some(self, which: IndexArray) -> "Curve":
        """Return the curve with some of its points."""
        arrays = ("before_mm", "points_mm", "after_mm", "shift", "out", "design", "chord_mm")
        return replace(self, **{name: getattr(self, name)[which] for name in arrays})

    def moved(self, by_mm: FloatArray) -> "Curve":
        """Return the curve moved as a whole by a vector (3,), CAD frame."""
        points = ("before_mm", "points_mm", "after_mm")
        return replace(self, **{name: getattr(self, name) + by_mm for name in points})


def rim_curve(
    solid: Solid,
    rim: Rim,
    directions: tuple[FloatArray, FloatArray],
    pixel_mm: float,
    moved_mm: FloatArray,
    chords: Chords,
) -> Curve:
    """Return the points of a rim; unknowns: its place along two directions, and its radius.

    Parameters
    ----------
    solid : the part
    rim : nominal rim
    directions : (3,) each, from `rim_directions`, the same for all rims of a feature
    pixel_mm : pixel size at the rim
    moved_mm : (3,) deviations of its place along the directions, and of its radius, from nominal
    chords : chords of its mesh, see `chords_of`
    """
    first, second = directions
    centre = rim.centre_mm + moved_mm[0] * first + moved_mm[1] * second
    radius = rim.radius_mm + float(moved_mm[2])
    is_closed = rim.sweep_rad > FULL_RAD
    length_px = rim.radius_mm * rim.sweep_rad / pixel_mm
    count = int(np.clip(length_px / SPACING_PX, MIN_RAYS, MAX_RAYS))
    side = np.cross(rim.axis, rim.start)
    if is_closed:
        angle = np.arange(count, dtype=np.float64) * (rim.sweep_rad / count)
    else:
        corner = min(CORNER_PX * pixel_mm / radius, 0.25 * rim.sweep_rad)
        angle = np.linspace(corner, rim.sweep_rad - corner, count)

    def radial(at: NDArray[np.floating]) -> FloatArray:
        return np.asarray(np.cos(at)[:, None] * rim.start + np.sin(at)[:, None] * side, np.float64)

    course = rim.course

    def slid(at: FloatArray, step: FloatArray) -> FloatArray:
        """Return a step of the wall (n, 3) plus the rim's motion along the surface beyond."""
        if course is None:
            return step
        normal = course.normal(at)
        rise = (normal * step).sum(axis=1) / (normal @ rim.axis)
        return np.asarray(step - rise[:, None] * rim.axis)

    def place(at: FloatArray) -> FloatArray:
        way = radial(at)
        step = centre - rim.centre_mm + float(moved_mm[2]) * way
        raised = 0.0 if course is None else course.height_mm(at)[:, None] * rim.axis
        return np.asarray(rim.centre_mm + rim.radius_mm * way + raised + slid(at, step))

    out_radial = radial(angle)
    if course is not None:
        normal = course.normal(angle)
    else:
        normal = solid.faces[rim.beyond].normal
        if abs(float(normal @ rim.axis)) < 0.5:
            normal = rim.axis
    out = (-out_radial if rim.is_hole else out_radial) + normal
    # All rims of a feature turn together, even if their axes are opposite.
    sense = 1.0 if float(np.cross(first, second) @ rim.axis) > 0 else -1.0
    steps = (np.broadcast_to(first, out.shape), np.broadcast_to(second, out.shape), out_radial)
    design = np.stack([slid(angle, step) for step in steps], axis=1)
    return Curve(
        before_mm=place(angle - NEIGHBOUR),
        points_mm=place(angle),
        after_mm=place(angle + NEIGHBOUR),
        shift=out_radial if course is None else _units(design[:, 2]),
        out=out / np.linalg.norm(out, axis=1, keepdims=True),
        design=design,
        facet_mm=chords.height_mm,
        outward=-1.0 if rim.is_hole else 1.0,
        chord_mm=-chords.turned_mm(angle, rim.radius_mm, sense)[..., None] * out_radial[:, None],
    )


def plane_rim_curve(
    solid: Solid,
    rim: Rim,
    direction: FloatArray,
    pixel_mm: float,
    moved_mm: float,
    chords: Chords,
) -> Curve:
    """Return the points of a rim that shows a plane; unknowns: its shift, and its radius.

    Parameters
    ----------
    solid : the part
    rim : nominal rim
    direction : (3,) unit, square to the plane
    pixel_mm : pixel size at the rim
    moved_mm : deviation of the plane from its nominal place, along the direction
    chords : chords of its mesh, see `chords_of`
    """
    curve = rim_curve(solid, rim, rim_directions(rim.axis), pixel_mm, np.zeros(3), chords)
    step = moved_mm * direction
    shift = np.broadcast_to(direction, curve.points_mm.shape)
    normals = [solid.faces[face].normal for face in (rim.wall, rim.beyond)]
    along = max((float(normal @ direction) for normal in normals), key=abs)
    return replace(
        curve,
        before_mm=curve.before_mm + step,
        points_mm=curve.points_mm + step,
        after_mm=curve.after_mm + step,
        shift=shift,
        design=np.stack([shift, curve.design[:, 2]], axis=1),
        outward=1.0 if along > 0 else -1.0,
    )


def turn_of(rim: Rim, points_mm: FloatArray) -> FloatArray:
    """Return the angles (n,) of points (n, 3) about an arc's axis, from its middle."""
    side = np.cross(rim.axis, rim.start)
    away = points_mm - rim.centre_mm
    half = 0.5 * rim.sweep_rad
    middle = np.cos(half) * rim.start + np.sin(half) * side
    beside = np.cross(rim.axis, middle)
    return np.asarray(np.arctan2(away @ beside, away @ middle))


def line_curve(
    solid: Solid, line: EdgeLine, direction: FloatArray, pixel_mm: float, moved_mm: float
) -> Curve:
    """Return the points of a straight edge; unknowns: its shift along a direction, and its slope.

    Parameters
    ----------
    solid : the part
    line : nominal edge
    direction : (3,) unit, square to the edge
    pixel_mm : pixel size at the edge
    moved_mm : deviation of the edge from its nominal place, along the direction
    """
    along = line.end_mm - line.start_mm
    length = float(np.linalg.norm(along))
    along = along / max(length, 1e-9)
    corner = min(CORNER_PX * pixel_mm, 0.3 * length)
    count = int(np.clip((length - 2 * corner) / pixel_mm / SPACING_PX, MIN_RAYS, MAX_RAYS))
    place = np.linspace(corner - 0.5 * length, 0.5 * length - corner, count)
    middle = 0.5 * (line.start_mm + line.end_mm) + moved_mm * direction
    points = middle + place[:, None] * along
    out: FloatArray = np.sum([solid.faces[face].normal for face in line.faces], axis=0)
    size = float(np.linalg.norm(out))
    out = out / size if size > 0.1 else direction
    shift = np.broadcast_to(direction, points.shape)
    slope = (2.0 * place / length)[:, None] * direction
    step = NEIGHBOUR * length * along
    return Curve(
        before_mm=points - step,
        points_mm=points,
        after_mm=points + step,
        shift=shift,
        out=np.broadcast_to(out, points.shape),
        design=np.stack([shift, slope], axis=1),
        facet_mm=0.0,
        outward=_outward(solid, line, direction),
        chord_mm=np.zeros((len(points), TURN_COUNT, 3)),
    )


def _outward(solid: Solid, line: EdgeLine, direction: FloatArray) -> float:
    """Return 1 if a shift moves the edge's own face out of the material, else -1."""
    along = [float(solid.faces[face].normal @ direction) for face in line.faces]
    return 1.0 if max(along, key=abs) > 0 else -1.0


def chords_of(solid: Solid, rim: Rim) -> Chords:
    """Return the chords of a rim in the mesh of its wall."""
    if rim.course is not None:
        angles, radii = rim.course.angles_rad, rim.course.radii_mm
        middle = angles + 0.5 * np.diff(angles, append=angles[0] + 2 * np.pi)
        bare = Chords(angles, radii, 0.0)
        depth = bare.depth_mm(middle, rim.radius_mm)
        return Chords(angles, radii, max(float(np.median(depth)), 0.0))
    triangles = np.asarray(solid.mesh.faces)[solid.face_of_triangle == rim.wall]
    vertices = np.asarray(solid.mesh.vertices)[np.unique(triangles)] - rim.centre_mm
    height = vertices @ rim.axis
    near = vertices[np.abs(height) < 0.05]
    side = np.cross(rim.axis, rim.start)
    angle = np.sort(np.arctan2(near @ side, near @ rim.start))
    if len(angle) < MIN_CHORDS:
        return Chords(np.zeros(0), np.zeros(0), 0.0)
    gaps = np.diff(angle)
    is_next = gaps > SAME_RAD
    gap = float(np.median(gaps[is_next])) if is_next.any() else 0.0
    height_mm = float(rim.radius_mm * (1.0 - np.cos(0.5 * gap)))
    angle = angle[np.concatenate([[True], is_next])]
    return Chords(angle, np.full(len(angle), rim.radius_mm), height_mm)


def _units(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
