"""Value of a characteristic in one picture from fitted features, with uncertainties by name.

Every source of error is carried as a covariance of the value. Errors common to two edges, such as
those of the pose, thus cancel in their difference, and an error of depth becomes one of scale.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.imaging import inverse_pose, transform
from messages import joined, key, say

from ..characteristics import (
    Characteristic,
    CharacteristicKind,
    EdgeLine,
    EdgePairGeometry,
    Look,
    Rim,
    RimGeometry,
    rim_directions,
)
from ._features import FaceFeature, Feature, FeatureFit, RecessFeature, RimFeature
from ._types import MeasuringSettings, PosedView

NOISE: Final = key("edge noise")
LIGHT: Final = key("edge type and light")
WALL: Final = key("walls seen flat")
SHADOW: Final = key("shadows that end beside it")
BLUR: Final = "curvature"
FACETS: Final = key("CAD facets")
POSE: Final = "pose"
LENS: Final = "lens"
SCALE: Final = "scale"
TEMPERATURE: Final = "temperature"
MAX_EDGES: Final = 4  # number of a plane's longest edges used; each costs as much as a bore
SAME_AXIS_MM: Final = 0.05  # distance between axes below which arcs belong to one end of a slot
# Kinds that follow from a circle's place or radius; a depth does not.
OF_A_RIM: Final = frozenset(
    {
        CharacteristicKind.DIAMETER,
        CharacteristicKind.POSITION,
        CharacteristicKind.RADIUS,
        CharacteristicKind.ROUNDNESS,
    }
)
# Ratio of the 95 % ranges in two directions, 2.45 standard deviations, and in one, 1.96.
ROUND: Final = 2.45 / 2.0
# Distance from nominal, in uncertainties, beyond which a place is off in one direction.
FAR_OUT: Final = 3.0
MIN_SINE: Final = 1e-3  # along the axis of a recess its depth does not show at all
NOTHING: Final[Mapping[str, FloatArray]] = MappingProxyType({})


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """Estimate of a characteristic from one picture, before looks are combined.

    Attributes
    ----------
    look : record for the report, with the reason where it does not count
    vector_mm : (m,) deviation from nominal; two components for a position, in the directions of
        `rim_directions`, else one
    parts : covariances (m, m) by name of the error
    towards : (3,) unit, CAD frame, to the camera
    grasp : grasp of the view
    is_part : True if its only reason is that too little of an edge shows
    """

    look: Look
    vector_mm: FloatArray
    parts: Mapping[str, FloatArray]
    towards: FloatArray
    grasp: int
    is_part: bool = False


def features_of(characteristic: Characteristic) -> tuple[Feature, ...]:
    """Return the features to fit for a characteristic: one, two, or three.

    There are none where the CAD model has no edge that shows it.
    """
    geometry, kind = characteristic.geometry, characteristic.kind
    if isinstance(geometry, RimGeometry):
        if kind is CharacteristicKind.POSITION:
            placed = tuple(RimFeature(end) for end in _slot_ends(geometry.rims))
            return (*placed, RimFeature(geometry.datum)) if geometry.datum else placed
        if kind is CharacteristicKind.LENGTH:
            ends = _slot_ends(geometry.rims)
            return tuple(RimFeature(end) for end in ends) if len(ends) == 2 else ()
        return (RimFeature(geometry.rims),) if kind in OF_A_RIM else ()
    if geometry.is_depth:
        lines = tuple(zip(geometry.other, geometry.one, strict=True))
        rims = tuple(zip(geometry.other_rims, geometry.one_rims, strict=True))
        return (RecessFeature(geometry.direction, lines, rims),)
    if kind is CharacteristicKind.STRAIGHTNESS:
        return (_face(geometry.one[:1], geometry.direction),) if geometry.one else ()
    if kind is CharacteristicKind.ANGLE:
        return _sides(geometry) if geometry.one and geometry.other else ()
    if not (geometry.one or geometry.one_rims) or not (geometry.other or geometry.other_rims):
        return ()
    return (
        _face(geometry.one, geometry.direction, geometry.one_rims),
        _face(geometry.other, geometry.direction, geometry.other_rims),
    )


def _slot_ends(rims: tuple[Rim, ...]) -> tuple[tuple[Rim, ...], ...]:
    """Return the arcs of a slot's round ends, grouped by axis."""
    ends: list[list[Rim]] = []
    for rim in rims:
        for end in ends:
            off = rim.centre_mm - end[0].centre_mm
            if np.linalg.norm(off - (off @ rim.axis) * rim.axis) < SAME_AXIS_MM:
                end.append(rim)
                break
        else:
            ends.append([rim])
    return tuple(tuple(end) for end in ends)


@dataclass(frozen=True, eq=False, slots=True)
class Sought:
    """A characteristic to be sought in pictures.

    Attributes
    ----------
    characteristic : the characteristic
    features : features to fit, by a key that is equal for features that need only one fit
    rows : (m, p) each, derivatives of the value by the unknowns of each feature
    length_mm : length that the value spans
    """

    characteristic: Characteristic
    features: Mapping[tuple[object, ...], Feature]
    rows: tuple[FloatArray, ...]
    length_mm: float

    @property
    def is_halved(self) -> bool:
        """True if the value depends on two features, which different pictures may show."""
        is_angle = self.characteristic.kind is CharacteristicKind.ANGLE
        return not is_angle and len(self.features) == 2

    def middle_mm(self, which: int) -> FloatArray:
        """Return the middle (3,) of a feature, given by its number, CAD frame."""
        return tuple(self.features.values())[which].middle_mm


def seek(characteristic: Characteristic, solid: Solid) -> Sought | None:
    """Return the edges to look for in pictures; None where no edge of the part shows it.

    Parameters
    ----------
    characteristic : what is asked
    solid : the part
    """
    features = features_of(characteristic)
    if not features:
        return None
    # A value has one row per feature, except deviations of form, which have none.
    is_form = characteristic.kind in (CharacteristicKind.ROUNDNESS, CharacteristicKind.STRAIGHTNESS)
    rows, length_mm = ([], 0.0) if is_form else _rows(characteristic, features, solid)
    by_key = {feature_key(feature): feature for feature in features}
    return Sought(characteristic, by_key, tuple(rows), length_mm)


def feature_key(feature: Feature) -> tuple[object, ...]:
    """Return a key that is equal for features that need only one fit."""
    if isinstance(feature, RimFeature):
        return tuple(id(rim) for rim in feature.rims)
    if isinstance(feature, RecessFeature):
        return tuple(id(edge) for pair in (*feature.lines, *feature.rims) for edge in pair)
    edges = (*feature.lines, *feature.rims)
    return (feature.directions.tobytes(), *(id(edge) for edge in edges))


def estimate(
    sought: Sought,
    fits: Sequence[FeatureFit],
    view: PosedView,
    lamp: str,
    settings: MeasuringSettings,
    only: int | None = None,
) -> Estimate:
    """Return an estimate from one picture of a characteristic, or of one of its two features.

    Parameters
    ----------
    sought : the sought characteristic
    fits : fits of its features, in order
    view, lamp : view and lamp of the picture
    settings : uncertainties before any picture
    only : number of one feature, where the other is taken from other pictures; None for all
    """
    characteristic = sought.characteristic
    if only is not None:
        fits = fits[only : only + 1]
    T = view.T_world_part_measured
    eye = transform(inverse_pose(T), view.task.camera.position_mm[None])[0]
    middle = sought.middle_mm(only or 0)
    towards = (eye - middle) / np.linalg.norm(eye - middle)
    reason: str = joined("; ", dict.fromkeys(fit.reason for fit in fits if fit.reason))
    if any(len(fit.values_mm) == 0 for fit in fits):
        look = _look(characteristic, view, lamp, float("nan"), float("inf"), reason, {}, fits)
        return Estimate(look, np.zeros(1), NOTHING, towards, view.grasp)
    pixel_mm = view.task.camera.mm_per_px(transform(T, middle[None])[0])
    lens = (settings.lens_px * pixel_mm) ** 2
    if characteristic.kind in (CharacteristicKind.ROUNDNESS, CharacteristicKind.STRAIGHTNESS):
        parts = {NOISE: np.array([[fits[0].form_u_mm ** 2]]), LENS: np.array([[lens]])}
        vector = np.array([fits[0].form_mm - characteristic.nominal_mm])
    else:
        rows, length_mm = sought.rows, sought.length_mm
        if only is not None:
            # Errors that grow with the length count once.
            rows, length_mm = rows[only : only + 1], length_mm * (only == 0)
        vector = np.sum([r @ f.values_mm for r, f in zip(rows, fits, strict=True)], axis=0)
        is_angle = characteristic.kind is CharacteristicKind.ANGLE
        parts = _parts(rows, fits, view.covariance)
        one = np.eye(len(vector))
        if is_angle:
            arm = min(_length(line) for f in sought.features.values() for line in _lines(f))
            parts[LENS] = one * lens * (2.0 / arm) ** 2
        else:
            # A displacement in the picture is a depth times the sine of the angle to its axis.
            sine = _sine(towards, characteristic) if characteristic.is_depth else 1.0
            parts[LENS] = one * lens / max(sine, MIN_SINE) ** 2
            parts[SCALE] = one * (settings.scale * length_mm) ** 2
            expansion = settings.expansion_per_k * settings.temperature_k
            parts[TEMPERATURE] = one * (expansion * length_mm) ** 2
    total = np.sum(list(parts.values()), axis=0)
    value, u = value_of(characteristic, vector, total)
    if not reason and characteristic.is_depth and value <= FAR_OUT * u:
        reason = key("the edge found in place of its floor may be that of its mouth")
    is_part = bool(reason) and all(fit.is_part or not fit.reason for fit in fits)
    if (is_part or not reason) and 2.0 * u > characteristic.tolerance_mm:
        angle = np.degrees(np.arccos(min(abs(float(towards @ _facing(characteristic))), 1.0)))
        unit = "rad" if characteristic.kind is CharacteristicKind.ANGLE else "mm"
        reason = say(
            "U would be {U:.3f} {unit} at {angle:.0f} degrees of incidence, "
            "its tolerance is {tolerance_mm:.3f} {unit} wide",
            U=2.0 * u,
            unit=unit,
            angle=angle,
            tolerance_mm=characteristic.tolerance_mm,
        )
        is_part = False
    budget = {name: math.sqrt(largest_eigenvalue(part)) for name, part in parts.items()}
    look = _look(characteristic, view, lamp, value, u, reason, budget, fits)
    return Estimate(look, vector, parts, towards, view.grasp, is_part)


def _sine(towards: FloatArray, characteristic: Characteristic) -> float:
    return float(np.linalg.norm(np.cross(towards, _facing(characteristic))))


def largest_eigenvalue(symmetric: FloatArray) -> float:
    """Return the largest eigenvalue of a symmetric matrix (m, m); most have one entry."""
    if len(symmetric) == 1:
        return float(symmetric[0, 0])
    return float(np.linalg.eigvalsh(symmetric)[-1])


def value_of(
    characteristic: Characteristic, vector_mm: FloatArray, covariance: FloatArray
) -> tuple[float, float]:
    """Return the value and its standard uncertainty; for a position, its distance from nominal.

    Parameters
    ----------
    characteristic : what is asked
    vector_mm, covariance : (m,) deviation from nominal, and its (m, m) covariance
    """
    u = math.sqrt(max(largest_eigenvalue(covariance), 0.0))
    if characteristic.kind is CharacteristicKind.POSITION:
        off = float(np.linalg.norm(vector_mm))
        return off, u if off > FAR_OUT * u else ROUND * u
    return characteristic.nominal_mm + float(vector_mm[0]), u


def _parts(
    rows: Sequence[FloatArray], fits: Sequence[FeatureFit], covariance: FloatArray
) -> dict[str, FloatArray]:
    """Return the covariances of a linear function of features, by name.

    Parameters
    ----------
    rows : (m, p) derivatives by each feature's unknowns
    fits : fit of each feature
    covariance : (6, 6) covariance of the pose
    """
    noise = np.sum([r @ f.noise @ r.T for r, f in zip(rows, fits, strict=True)], axis=0)
    pose = np.sum([r @ f.pose for r, f in zip(rows, fits, strict=True)], axis=0)
    parts = {NOISE: noise, POSE: pose @ covariance @ pose.T}
    for name, which in (
        (LIGHT, "edge"),
        (WALL, "wall"),
        (SHADOW, "shadow"),
        (BLUR, "blur"),
        (FACETS, "facets"),
    ):
        each = [
            (r @ getattr(f, which)).reshape(len(pose), -1) for r, f in zip(rows, fits, strict=True)
        ]
        by = np.sum(each, axis=0)
        together, apart = by @ by.T, np.sum([one @ one.T for one in each], axis=0)
        # Light may affect two edges differently, so its error does not cancel in the difference.
        is_less = name == LIGHT and np.trace(together) < np.trace(apart)
        parts[name] = apart if is_less else together
    return parts


def _rows(
    characteristic: Characteristic, features: Sequence[Feature], solid: Solid
) -> tuple[list[FloatArray], float]:
    """Return the derivatives of the value by the features' unknowns, and its length [mm]."""
    kind, geometry = characteristic.kind, characteristic.geometry
    if isinstance(geometry, RimGeometry):
        rim = geometry.rims[0]
        own = np.array(rim_directions(rim.axis))
        if kind is CharacteristicKind.POSITION:
            placed = features[: len(features) - bool(geometry.datum)]
            rows = [_across(own, feature) / len(placed) for feature in placed]
            datum = solid.centroid_mm
            if geometry.datum:
                directions = np.array(rim_directions(geometry.datum[0].axis))
                rows.append(np.column_stack([-own @ directions.T, np.zeros(2)]))
                datum = geometry.datum[0].centre_mm
            away = rim.centre_mm - datum
            away = away - (away @ rim.axis) * rim.axis
            return rows, characteristic.length_mm or float(np.linalg.norm(away))
        if kind is CharacteristicKind.LENGTH:
            # Length from end to end: the distance between the axes plus both radii.
            way = features[1].middle_mm - features[0].middle_mm
            way = way - (way @ rim.axis) * rim.axis
            way /= max(float(np.linalg.norm(way)), 1e-9)
            rows = []
            for sign, feature in zip((-1.0, 1.0), features, strict=True):
                assert isinstance(feature, RimFeature)
                axis = feature.rims[0].axis
                along = np.array(rim_directions(axis)) @ way
                rows.append(np.array([[*(sign * along), 1.0]]))
            return rows, characteristic.nominal_mm
        factor = 1.0 if kind is CharacteristicKind.RADIUS else 2.0
        return [np.array([[0.0, 0.0, factor]])], characteristic.nominal_mm
    if kind is CharacteristicKind.ANGLE:
        rows = []
        for sign, feature in zip(_turn(characteristic, geometry), features, strict=True):
            row = np.zeros((1, feature.unknown_count))
            row[0, 1] = sign * 2.0 / _length(_lines(feature)[0])
            rows.append(row)
        return rows, 0.0
    rows = []
    signs = (1.0,) if geometry.is_depth else (-1.0, 1.0)
    for sign, feature in zip(signs, features, strict=True):
        row = np.zeros((1, feature.unknown_count))
        row[0, 0] = sign
        rows.append(row)
    return rows, characteristic.nominal_mm


def _across(own: FloatArray, feature: Feature) -> FloatArray:
    """Return the derivatives (2, 3) of a place in its own directions by a feature's unknowns."""
    assert isinstance(feature, RimFeature)
    directions = np.array(rim_directions(feature.rims[0].axis))
    return np.column_stack([own @ directions.T, np.zeros(2)])


def _facing(characteristic: Characteristic) -> FloatArray:
    """Return the direction (3,) from which a characteristic is seen best."""
    geometry = characteristic.geometry
    if isinstance(geometry, RimGeometry):
        return np.asarray(geometry.rims[0].axis)
    if geometry.is_depth:
        return geometry.direction
    lines = (*geometry.one, *geometry.other)
    if not lines:
        return np.asarray(rim_directions(geometry.direction)[0])
    across = np.cross(geometry.direction, _along(lines[0]))
    return np.asarray(across / max(float(np.linalg.norm(across)), 1e-9))


def _face(
    lines: tuple[EdgeLine, ...], direction: FloatArray, rims: tuple[Rim, ...] = ()
) -> FaceFeature:
    lines, rims = lines[:MAX_EDGES], rims[:MAX_EDGES]
    return FaceFeature(lines, np.broadcast_to(direction, (max(len(lines), 1), 3)), rims)


def _sides(geometry: EdgePairGeometry) -> tuple[FaceFeature, FaceFeature]:
    """Return the longest edge of each face, turning about the normal of the plane they span."""
    one = max(geometry.one, key=_length)
    other = max(geometry.other, key=_length)
    first, second = _along(one), _along(other)
    normal = np.cross(first, second)
    normal /= max(float(np.linalg.norm(normal)), 1e-9)
    return (
        FaceFeature((one,), np.cross(normal, first)[None]),
        FaceFeature((other,), np.cross(normal, second)[None]),
    )


def _turn(characteristic: Characteristic, geometry: EdgePairGeometry) -> tuple[float, float]:
    """Return the signs with which the turns of both edges count."""
    one, other = max(geometry.one, key=_length), max(geometry.other, key=_length)
    between = float(np.arccos(np.clip(_along(one) @ _along(other), -1.0, 1.0)))
    is_same = abs(characteristic.nominal_mm - between) <= abs(
        characteristic.nominal_mm - (np.pi - between)
    )
    return (-1.0, 1.0) if is_same else (1.0, -1.0)


def _along(line: EdgeLine) -> FloatArray:
    return np.asarray((line.end_mm - line.start_mm) / max(_length(line), 1e-9))


def _length(line: EdgeLine) -> float:
    return float(np.linalg.norm(line.end_mm - line.start_mm))


def _lines(feature: Feature) -> tuple[EdgeLine, ...]:
    return feature.lines if isinstance(feature, FaceFeature) else ()


def _look(
    characteristic: Characteristic,
    view: PosedView,
    lamp: str,
    value: float,
    u: float,
    reason: str,
    budget: Mapping[str, float],
    fits: Sequence[FeatureFit],
) -> Look:
    points = np.concatenate([fit.points_px for fit in fits])
    accepted = np.concatenate([fit.accepted for fit in fits])
    return Look(
        view_id=view.task.view_id,
        lamp=lamp,
        measured_mm=value,
        u_mm=u,
        reason=reason,
        budget=dict(budget),
        points_px=points,
        accepted=accepted.astype(np.float64),
        shape_px=np.concatenate([fit.shape_px for fit in fits]),
    )
