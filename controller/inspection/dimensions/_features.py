"""Features to fit in a picture: holes and bosses by their rims, faces by their edges."""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray
from controller.cad import Solid

from ..characteristics import EdgeLine, Rim, rim_directions
from ..characteristics.edges.rims import FULL_RAD
from ._curves import (
    Chords,
    Curve,
    chords_of,
    line_curve,
    plane_rim_curve,
    rim_curve,
    turn_of,
)
from ._rays import Rays

MIN_TURN_RAD: Final = 1e-3  # turn below which an arc counts as straight
WAVES: Final = 3  # number of waves round a circle in which light may move its edge
NO_POINTS: Final = np.zeros((0, 2))


class _OneLevel:
    """Feature with all its edges at one level."""

    @property
    def level_count(self) -> int:
        """Number of levels at which it has edges."""
        return 1

    def level(self, curve: IndexArray) -> IndexArray:
        """Return the level of its edges (n,), from 0; each level has to be in sight."""
        return np.zeros(len(curve), dtype=np.intp)


@dataclass(eq=False)
class RimFeature(_OneLevel):
    """A hole or a boss; unknowns: its place along `rim_directions` of its axis, and its radius.

    Attributes
    ----------
    rims : arcs of the same radius on the same axis
    """

    rims: tuple[Rim, ...]
    _chords: tuple[Chords, ...] = ()

    @property
    def unknown_count(self) -> int:
        """Number of unknowns of the whole feature."""
        return 3

    def curves(self, solid: Solid, pixel_mm: float, moved_mm: FloatArray) -> list[Curve]:
        """Return its edges, moved by the unknowns found so far.

        Parameters
        ----------
        solid : the part
        pixel_mm : size of a pixel there
        moved_mm : (3,) the unknowns
        """
        if not self._chords:
            self._chords = tuple(chords_of(solid, rim) for rim in self.rims)
        directions = rim_directions(self.rims[0].axis)
        return [
            rim_curve(solid, rim, directions, pixel_mm, moved_mm, chords)
            for rim, chords in zip(self.rims, self._chords, strict=True)
        ]

    def design(self, rays: Rays, curve: FloatArray) -> FloatArray:
        """Return the derivatives (n, 3) of offsets; `curve` (n,) is the edge of each, from 0."""
        return rays.design[:, :3]

    def light_modes(self, rays: Rays, curve: IndexArray) -> FloatArray:
        """Return the modes (n, k) in which light may move its edges, as a whole and unevenly.

        Round a whole circle, only the first mode changes the radius and only the next two the
        place. On a visible arc, all other modes change one or the other as well. The angles of an
        arc are those in space, times the ratio of its turns in space and in the picture, the larger
        over the smaller: at a grazing angle a small effect of light bends the arc like another
        radius.
        """
        rim = self.rims[0]
        if rim.sweep_rad > FULL_RAD:
            return _waves(rays, _normal_angles(rays))
        turn = turn_of(rim, rays.points_mm)
        stretch = float(np.ptp(turn)) / max(_picture_turn_rad(rays), MIN_TURN_RAD)
        return _waves(rays, turn * min(max(stretch, 1.0 / stretch), 2 * np.pi / rim.sweep_rad))

    @property
    def sought_first(self) -> BoolArray:
        """Mask (3,) of the unknowns solved for in the first look."""
        return self.kept

    @property
    def kept(self) -> BoolArray:
        """Mask (3,) of the unknowns that the second look takes over from the first.

        On an arc, radius and place are hardly separable: with another radius the second look would
        search along another arc, of another length.
        """
        return np.array([True, True, self.rims[0].sweep_rad > FULL_RAD])

    @property
    def middle_mm(self) -> FloatArray:
        """Middle of the feature, (3,), CAD frame."""
        return np.asarray(self.rims[0].centre_mm)


@dataclass(eq=False)
class FaceFeature(_OneLevel):
    """A plane by its edges; unknowns: its shift, then the slope or the radius of each edge.

    Attributes
    ----------
    lines : straight edges that lie on it
    directions : (k, 3) unit, direction of each edge's shift
    rims : circular edges that lie on it, shifted along the first direction
    """

    lines: tuple[EdgeLine, ...]
    directions: FloatArray
    rims: tuple[Rim, ...] = ()
    _chords: tuple[Chords, ...] = ()

    @property
    def unknown_count(self) -> int:
        """Number of unknowns of the whole feature."""
        return 1 + len(self.lines) + len(self.rims)

    def curves(self, solid: Solid, pixel_mm: float, moved_mm: FloatArray) -> list[Curve]:
        """Return its edges, moved by the unknowns found so far.

        Parameters
        ----------
        solid : the part
        pixel_mm : size of a pixel there
        moved_mm : (p,) the unknowns; slopes and radii stay nominal
        """
        if len(self._chords) < len(self.rims):
            self._chords = tuple(chords_of(solid, rim) for rim in self.rims)
        shift = float(moved_mm[0])
        return [
            line_curve(solid, line, direction, pixel_mm, shift)
            for line, direction in zip(self.lines, self.directions, strict=False)
        ] + [
            plane_rim_curve(solid, rim, self.directions[0], pixel_mm, shift, chords)
            for rim, chords in zip(self.rims, self._chords, strict=True)
        ]

    def design(self, rays: Rays, curve: FloatArray) -> FloatArray:
        """Return the derivatives (n, p) of offsets; `curve` (n,) is the edge of each, from 0."""
        out = np.zeros((len(rays.pixels), self.unknown_count))
        out[:, 0] = rays.design[:, 0]
        out[np.arange(len(out)), 1 + curve.astype(np.intp)] = rays.design[:, 1]
        return out

    def light_modes(self, rays: Rays, curve: IndexArray) -> FloatArray:
        """Return the modes (n, k) in which light may move its edges, as a whole and unevenly."""
        return _waves(rays, _normal_angles(rays))

    @property
    def sought_first(self) -> BoolArray:
        """Mask (p,) of the unknowns solved for in the first look."""
        return np.ones(self.unknown_count, dtype=np.bool_)

    @property
    def kept(self) -> BoolArray:
        """Mask (p,) of the unknowns that the second look takes over from the first."""
        return np.asarray(np.arange(self.unknown_count) == 0, dtype=np.bool_)

    @property
    def middle_mm(self) -> FloatArray:
        """Middle of the feature, (3,), CAD frame."""
        if self.lines:
            return np.asarray(0.5 * (self.lines[0].start_mm + self.lines[0].end_mm))
        return np.asarray(self.rims[0].centre_mm)


@dataclass(eq=False)
class RecessFeature:
    """A blind recess by the edges of its mouth and its floor.

    Unknowns: its depth; then the shift of each plane wall along its normal; then, of each round
    wall, the place along `rim_directions` and the radius. Both edges of a wall move with it.

    Attributes
    ----------
    axis : (3,) unit, out of the mouth
    lines : straight edges of each plane wall, at the mouth and at the floor
    rims : arcs of each round wall, at the mouth and at the floor
    """

    axis: FloatArray
    lines: tuple[tuple[EdgeLine, EdgeLine], ...]
    rims: tuple[tuple[Rim, Rim], ...] = ()
    _chords: tuple[Chords, ...] = ()

    @property
    def unknown_count(self) -> int:
        """Number of unknowns of the whole feature."""
        return 1 + len(self.lines) + 3 * len(self.rims)

    def curves(self, solid: Solid, pixel_mm: float, moved_mm: FloatArray) -> list[Curve]:
        """Return its edges, moved by the unknowns found so far, mouth and floor in turn.

        Parameters
        ----------
        solid : the part
        pixel_mm : size of a pixel there
        moved_mm : (p,) the unknowns
        """
        if len(self._chords) < 2 * len(self.rims):
            self._chords = tuple(chords_of(solid, rim) for pair in self.rims for rim in pair)
        found: list[tuple[Curve, FloatArray, int]] = []
        at = 1
        for pair in self.lines:
            normal = solid.faces[pair[0].faces[0]].normal
            for line in pair:
                curve = line_curve(solid, line, normal, pixel_mm, float(moved_mm[at]))
                found.append((curve, curve.design[:, :1], at))
            at += 1
        chords = iter(self._chords)
        for rims in self.rims:
            directions = rim_directions(rims[0].axis)
            for rim in rims:
                by = moved_mm[at : at + 3]
                curve = rim_curve(solid, rim, directions, pixel_mm, by, next(chords))
                found.append((curve, curve.design, at))
            at += 3
        return [
            self._sunk(curve, own, at, float(moved_mm[0]) * (i % 2), i % 2)
            for i, (curve, own, at) in enumerate(found)
        ]

    def _sunk(self, curve: Curve, own: FloatArray, at: int, by_mm: float, floor: int) -> Curve:
        """Return a curve, lower by some millimetres, with derivatives by all unknowns.

        Parameters
        ----------
        curve : edge of a wall
        own : (n, k, 3) derivatives by the wall's own unknowns, the first of which is number `at`
        by_mm : deviation of the depth; 0 at the mouth
        floor : 1 at the floor, 0 at the mouth
        """
        design = np.zeros((len(own), self.unknown_count, 3))
        design[:, 0] = -floor * self.axis
        design[:, at : at + own.shape[1]] = own
        return replace(curve.moved(-by_mm * self.axis), design=design)

    def design(self, rays: Rays, curve: FloatArray) -> FloatArray:
        """Return the derivatives (n, p) of offsets; `curve` (n,) is the edge of each, from 0."""
        return rays.design[:, : self.unknown_count]

    def light_modes(self, rays: Rays, curve: IndexArray) -> FloatArray:
        """Return the modes (n, k) in which light may move its edges, each on its own.

        A straight edge moves as a whole, an arc unevenly as well. The modes of an arc share the
        displacement of a point.
        """
        waves = _waves(rays, _normal_angles(rays))
        arc = waves / np.sqrt(1 + WAVES)
        straight = 2 * len(self.lines)
        each = [
            (waves[:, :1] if one < straight else arc) * (curve == one)[:, None]
            for one in np.unique(curve).tolist()
        ]
        return np.concatenate(each, axis=1)

    @property
    def level_count(self) -> int:
        """Number of levels at which it has edges."""
        return 2

    def level(self, curve: IndexArray) -> IndexArray:
        """Return 0 for edges (n,) of the mouth, and 1 for edges of the floor."""
        return np.asarray(curve % 2, dtype=np.intp)

    @property
    def sought_first(self) -> BoolArray:
        """Mask (p,) of the unknowns solved for in the first look."""
        return np.ones(self.unknown_count, dtype=np.bool_)

    @property
    def kept(self) -> BoolArray:
        """Mask (p,) of the unknowns that the second look takes over from the first."""
        return np.ones(self.unknown_count, dtype=np.bool_)

    @property
    def middle_mm(self) -> FloatArray:
        """Middle of the feature, (3,), CAD frame."""
        edges = [0.5 * (x.start_mm + x.end_mm) for pair in self.lines for x in pair]
        return np.asarray(np.mean([*edges, *(x.centre_mm for p in self.rims for x in p)], axis=0))


Feature = RimFeature | FaceFeature | RecessFeature


@dataclass(frozen=True, eq=False, slots=True)
class FeatureFit:
    """One picture's fit of a feature.

    Attributes
    ----------
    reason : reason why it does not count; empty where it does
    values_mm : (p,) unknowns, as deviations from nominal
    noise : (p, p) covariance from the scatter of the edge points [mm²]
    pose : (p, 6) derivatives by the part's position and rotation
    edge : (p, k) standard uncertainties from k modes of light moving edges
    wall, shadow, blur, facets : (p,) the same from walls at a grazing angle and outlines beside an
        edge, from shadows that end beside it, from blur of a round edge, and from a mesh that may
        be meant to be round
    points_px, accepted : (n, 2), (n,) edge points
    shape_px : (k, 2) fitted shape
    form_mm, form_u_mm : peak to valley of its edges about the shape, and its standard uncertainty
    share : share of the predicted rays
    is_part : True if it failed only since too little of its edge shows, see `min_part`
    """

    reason: str
    values_mm: FloatArray = field(default_factory=lambda: np.zeros(0))
    noise: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    pose: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    edge: FloatArray = field(default_factory=lambda: np.zeros((0, 1)))
    wall: FloatArray = field(default_factory=lambda: np.zeros(0))
    shadow: FloatArray = field(default_factory=lambda: np.zeros(0))
    blur: FloatArray = field(default_factory=lambda: np.zeros(0))
    facets: FloatArray = field(default_factory=lambda: np.zeros(0))
    points_px: FloatArray = field(default_factory=lambda: NO_POINTS)
    accepted: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    shape_px: FloatArray = field(default_factory=lambda: NO_POINTS)
    form_mm: float = 0.0
    form_u_mm: float = float("inf")
    share: float = 0.0
    is_part: bool = False


def _waves(rays: Rays, angle: FloatArray) -> FloatArray:
    """Return modes (n, k) of edges: out of the material, and waves round angles (n,)."""
    waves = [wave(k * angle) for k in range(1, WAVES + 1) for wave in (np.cos, np.sin)]
    return np.column_stack([rays.outward, *waves])


def _normal_angles(rays: Rays) -> FloatArray:
    return np.asarray(np.arctan2(rays.normals[:, 1], rays.normals[:, 0]))


def _picture_turn_rad(rays: Rays) -> float:
    """Return the spread of directions across an arc in the picture, less than a turn [rad]."""
    angle = _normal_angles(rays)
    middle = np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())
    return float(np.ptp(np.arctan2(np.sin(angle - middle), np.cos(angle - middle))))
