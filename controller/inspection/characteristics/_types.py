"""Characteristics that a drawing requires, and their measured values.

A characteristic is measured at edges of the part that pictures show: rims of holes and bosses, and
straight edges. Its geometry is therefore given by its nominal edges, in the CAD frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

import numpy as np

from controller.arrays import FloatArray, square_to
from messages import key

from .._types import Verdict


class CharacteristicKind(StrEnum):
    """Kind of a characteristic; the value is its name in files and JSON."""

    DIAMETER = key("diameter")
    POSITION = key("position")
    DISTANCE = key("distance")
    LENGTH = key("length")
    WIDTH = key("width")
    RADIUS = key("radius")
    ANGLE = key("angle")
    STRAIGHTNESS = key("straightness")
    ROUNDNESS = key("roundness")


# Prefix of the source of general tolerances, and of the reason where the standard gives none.
GENERAL: Final = "ISO 2768-"
ONE_SIDED: Final = frozenset(
    {CharacteristicKind.POSITION, CharacteristicKind.STRAIGHTNESS, CharacteristicKind.ROUNDNESS}
)


@dataclass(frozen=True, eq=False, slots=True)
class RimCourse:
    """Course of a non-planar rim round its cylinder, where a slope or a round cuts it.

    Attributes
    ----------
    angles_rad : (n,) ascending from 0, about the rim's axis from its start
    heights_mm : (n,) heights over the rim's centre, along its axis
    radii_mm : (n,) radii of the mesh's own points there
    normals : (n, 3) unit outward normals of the surface that cuts the cylinder
    """

    angles_rad: FloatArray
    heights_mm: FloatArray
    radii_mm: FloatArray
    normals: FloatArray

    def height_mm(self, at_rad: FloatArray) -> FloatArray:
        """Return the heights (k,) at angles (k,)."""
        turn = 2 * np.pi
        return np.asarray(np.interp(at_rad, self.angles_rad, self.heights_mm, period=turn))

    def normal(self, at_rad: FloatArray) -> FloatArray:
        """Return the normals (k, 3) at angles (k,)."""
        turn = 2 * np.pi
        mixed = np.column_stack(
            [np.interp(at_rad, self.angles_rad, own, period=turn) for own in self.normals.T]
        )
        return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False, slots=True)
class Rim:
    """Edge between a round wall and its neighbour: a circle, or a curve in space.

    Attributes
    ----------
    centre_mm : (3,) CAD frame, nominal
    axis : (3,) unit, out of the material at the rim's mouth
    radius_mm : nominal radius
    start, sweep_rad : (3,) unit direction to the start of the arc, and its sweep from there,
        anticlockwise as seen against `axis`; 2 pi for a whole circle
    wall, beyond : faces that meet in the rim
    is_hole : True if the wall faces its axis
    course : course of a non-planar rim, whose centre is at its mean height; None for a planar one
    """

    centre_mm: FloatArray
    axis: FloatArray
    radius_mm: float
    start: FloatArray
    sweep_rad: float
    wall: int
    beyond: int
    is_hole: bool
    course: RimCourse | None = None


@dataclass(frozen=True, eq=False, slots=True)
class EdgeLine:
    """A straight edge: nominal start and end (3,), CAD frame, and the two faces that meet in it."""

    start_mm: FloatArray
    end_mm: FloatArray
    faces: tuple[int, int]


@dataclass(frozen=True, eq=False, slots=True)
class RimGeometry:
    """A hole, a boss, a round or a slot, given by the rims that show it.

    The rims of a round are arcs. The rims of a slot with round ends are the arcs of both ends: the
    slot's length is the distance between their axes plus both radii.

    Attributes
    ----------
    rims : one or more rims, the widest open one first
    datum : rims of the datum wall of a position; empty where the datum is the part's outline
    """

    rims: tuple[Rim, ...]
    datum: tuple[Rim, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class EdgePairGeometry:
    """A distance between two planes, given by the edges that show each of them.

    Each plane may consist of several faces at one level. A round plane, such as the end of a disc,
    is shown by its rims alone.

    Attributes
    ----------
    one, other : straight edges in the first and in the second plane, longest first
    direction : (3,) unit, from the first to the second plane, square to both
    one_face, other_face : id of the largest face of each plane
    one_rims, other_rims : circular edges in the planes
    middle_mm : (3,) midpoint between the centres of both, CAD frame
    is_depth : True for the depth of a blind recess: the first plane is its floor, the second that
        of its mouth, and the edges of both are in pairs, one pair for each wall
    """

    one: tuple[EdgeLine, ...]
    other: tuple[EdgeLine, ...]
    direction: FloatArray
    one_face: int
    other_face: int
    one_rims: tuple[Rim, ...] = ()
    other_rims: tuple[Rim, ...] = ()
    middle_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    is_depth: bool = False


Geometry = RimGeometry | EdgePairGeometry


def place_of(geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return a characteristic's position (3,), CAD frame, and its axis or direction (3,), unit."""
    if isinstance(geometry, RimGeometry):
        return np.mean([rim.centre_mm for rim in geometry.rims], axis=0), geometry.rims[0].axis
    return geometry.middle_mm, geometry.direction


def rim_directions(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit directions (3,) that form a right-handed frame with an axis."""
    return square_to(axis)


@dataclass(frozen=True, eq=False, slots=True)
class Characteristic:
    """One requirement on a part.

    Attributes
    ----------
    id : unique in a part, stable from one compile to the next, such as ``hole 6.8 mm (2) diameter``
    balloon : number on the drawing and in the table, from 1
    kind : kind of characteristic
    label : name for people
    nominal_mm : nominal value; rad for an angle
    lower_mm, upper_mm : limits of the value itself, not of its deviation
    source : origin of the limits, such as ``ISO 2768-m``, ``recipe`` or ``AP242``
    geometry : edges that show it
    faces : ids of its faces
    is_critical : True if two independent looks must agree
    exempt : reason why a PASS of the part does not need it; empty where it does
    is_required : False where a PASS needs it neither verified nor measured
    is_measured : False where no picture shows it, or the recipe leaves it out
    length_mm : length with which its uncertainty grows, such as the distance of a position from its
        datum; 0 where this is the nominal value
    """

    id: str
    balloon: int
    kind: CharacteristicKind
    label: str
    nominal_mm: float
    lower_mm: float
    upper_mm: float
    source: str
    geometry: Geometry
    faces: tuple[int, ...]
    is_critical: bool = False
    exempt: str = ""
    is_required: bool = True
    is_measured: bool = True
    length_mm: float = 0.0

    @property
    def tolerance_mm(self) -> float:
        """Width of the tolerance; for a one-sided one, from 0 to its limit."""
        return self.upper_mm - self.lower_mm

    @property
    def is_general(self) -> bool:
        """True if its limits are general tolerances, with none stated for it."""
        return self.source.startswith(GENERAL)

    @property
    def is_one_sided(self) -> bool:
        """True if it is a deviation from an ideal, which cannot be below 0."""
        return self.kind in ONE_SIDED

    @property
    def is_depth(self) -> bool:
        """True if it is the depth of a blind recess, which few views show."""
        return isinstance(self.geometry, EdgePairGeometry) and self.geometry.is_depth

    def as_stated(self) -> "Characteristic":
        """Return the characteristic as if its limits were stated; measured if only these lacked."""
        if not self.exempt.startswith(GENERAL):
            return self
        return replace(self, exempt="", is_measured=True)


@dataclass(frozen=True, eq=False, slots=True)
class Look:
    """One picture's measurement of a characteristic.

    Attributes
    ----------
    view_id, lamp : the picture; the lamp is ``backlit`` before the panel
    measured_mm : measured value
    u_mm : its standard uncertainty
    reason : reason why it does not count; empty where it does
    budget : standard uncertainties that make up `u_mm`, by name [mm]
    points_px, accepted : (n, 2) edge points found, and (n,) 1 for those accepted, else 0, for the
        report
    shape_px : (k, 2) fitted shape in the picture, for the report
    """

    view_id: str
    lamp: str
    measured_mm: float
    u_mm: float
    reason: str = ""
    budget: Mapping[str, float] = field(default_factory=dict)
    points_px: FloatArray | None = None
    accepted: FloatArray | None = None
    shape_px: FloatArray | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """A characteristic with its result.

    Attributes
    ----------
    characteristic : the characteristic
    measured_mm : measured value; None where it was not evaluated
    U_mm : expanded uncertainty, k = 2; None where it was not evaluated
    verdict : by guard bands (ISO 14253-1), see `controller.inspection.characteristics.decide`
    views : views that contributed to it
    reason : reason why it was not evaluated or remains open, or the limit that it exceeds
    looks : measurements picture by picture
    is_disputed : True if looks contradict each other, or a required one is missing
    """

    characteristic: Characteristic
    measured_mm: float | None
    U_mm: float | None
    verdict: Verdict
    views: tuple[str, ...]
    reason: str
    looks: tuple[Look, ...] = ()
    is_disputed: bool = False
