"""Application of the limits stated in the CAD file (STEP AP242) to the characteristics.

They take precedence over general tolerances. Each is matched to a characteristic by its faces: a
diameter by its wall, a distance by its two planes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from controller.cad import Solid
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance, Tolerance
from messages import say

from .._types import (
    Characteristic,
    CharacteristicKind,
    EdgePairGeometry,
    Rim,
    RimGeometry,
    place_of,
)
from ..edges.rims import COAXIAL_COS
from ..limits import ToleranceClass, fit_limits_mm
from .planes import between
from .writer import pair_characteristic

SOURCE: Final = "AP242"
DIGITS: Final = 6  # number of decimals kept; sizes in inches have many
# Largest difference of nominal values between a drawing's dimension and its characteristic.
SAME_SIZE_MM: Final = 0.05
ROUND: Final = {
    "diameter": CharacteristicKind.DIAMETER,
    "radius": CharacteristicKind.RADIUS,
}
LINEAR: Final = frozenset(
    {CharacteristicKind.DISTANCE, CharacteristicKind.LENGTH, CharacteristicKind.WIDTH}
)


def with_drawn(
    solid: Solid,
    characteristics: Sequence[Characteristic],
    tolerances: Sequence[Tolerance],
    tolerance_class: ToleranceClass,
) -> tuple[Characteristic, ...]:
    """Return characteristics with a drawing's limits, and the further distances of the drawing.

    Parameters
    ----------
    solid : the part
    characteristics : its characteristics, with general tolerances
    tolerances : tolerances of its file
    tolerance_class : class for added characteristics without limits
    """
    found = list(characteristics)
    for tolerance in tolerances:
        if isinstance(tolerance, Dimension):
            _put_dimension(solid, found, tolerance, tolerance_class)
    zones = [t for t in tolerances if isinstance(t, GeometricTolerance) and t.kind == "position"]
    datums = {t.letter: t.faces for t in tolerances if isinstance(t, Datum)}
    _put_positions(found, zones, datums)
    return tuple(replace(c, balloon=i) for i, c in enumerate(found, start=1))


def _put_dimension(
    solid: Solid, found: list[Characteristic], drawn: Dimension, tolerance_class: ToleranceClass
) -> None:
    if drawn.is_angle or not drawn.faces:
        return
    kind = next((kind for word, kind in ROUND.items() if word in drawn.kind), None)
    if kind is not None:
        mine = [
            i
            for i, c in enumerate(found)
            if c.kind == kind and set(c.faces) & {*drawn.faces, *drawn.other_faces}
        ]
    else:
        mine = [i for i, c in enumerate(found) if c.kind in LINEAR and _joins(c, drawn)]
        planes = sorted({*drawn.faces, *drawn.other_faces})
        if not mine and len(planes) == 2:
            pair = between(solid, planes[0], planes[1])
            if pair is not None:
                found.append(pair_characteristic(pair, tolerance_class))
                mine = [len(found) - 1]
    for i in mine:
        if abs(found[i].nominal_mm - drawn.nominal) <= SAME_SIZE_MM:
            found[i] = _limited(found[i], drawn)


def _joins(characteristic: Characteristic, drawn: Dimension) -> bool:
    """Return True if a distance lies between the faces that a drawing names."""
    geometry = characteristic.geometry
    if isinstance(geometry, EdgePairGeometry) and geometry.one_face == geometry.other_face:
        return False  # the size of an unmeasured feature
    ends = set(characteristic.faces)
    if isinstance(geometry, EdgePairGeometry) and geometry.is_depth:
        ends = {geometry.one_face, geometry.other_face}
    if drawn.other_faces:
        return bool(ends & set(drawn.faces)) and bool(ends & set(drawn.other_faces))
    return ends <= set(drawn.faces)


def _limited(characteristic: Characteristic, drawn: Dimension) -> Characteristic:
    lower, upper = drawn.lower, drawn.upper
    if lower is None or upper is None:
        if not drawn.fit:
            return characteristic
        try:
            lower, upper = fit_limits_mm(drawn.fit, drawn.nominal)
        except ValueError:
            return characteristic  # unknown class: the general tolerance remains
    return replace(
        characteristic.as_stated(),
        nominal_mm=round(drawn.nominal, DIGITS),
        lower_mm=round(drawn.nominal + lower, DIGITS),
        upper_mm=round(drawn.nominal + upper, DIGITS),
        source=say("{source} {fit}", source=SOURCE, fit=drawn.fit).strip(),
        is_critical=True,
    )


def _put_positions(
    found: list[Characteristic],
    zones: Sequence[GeometricTolerance],
    datums: Mapping[str, tuple[int, ...]],
) -> None:
    """Limit the positions of axes to half their tolerance zones, from the drawing's datums.

    Where a drawing has a round and a flat zone, the round one counts: the measured value is the
    deviation of the axis in any direction. No bonus tolerance is used.
    """
    for i, c in enumerate(found):
        mine = [zone for zone in zones if set(c.faces) & set(zone.faces)]
        if c.kind != CharacteristicKind.POSITION or not mine:
            continue
        zone = min(mine, key=lambda zone: (not zone.is_diameter, zone.value_mm))
        datum_faces = {face for letter in zone.datums for face in datums.get(letter, ())}
        found[i] = replace(
            c,
            upper_mm=round(zone.value_mm / 2, DIGITS),
            source=SOURCE,
            is_critical=True,
            geometry=replace(c.geometry, datum=_datum_rims(found, c, datum_faces))
            if isinstance(c.geometry, RimGeometry)
            else c.geometry,
        )


def _datum_rims(
    found: Sequence[Characteristic], placed: Characteristic, faces: set[int]
) -> tuple[Rim, ...]:
    """Return the rims of the round datum along an axis; none where all datums are planes."""
    _, axis = place_of(placed.geometry)
    for c in found:
        if c.kind != CharacteristicKind.DIAMETER or not set(c.faces) & faces:
            continue
        if not isinstance(c.geometry, RimGeometry):
            continue  # no visible rim
        if set(c.faces) != set(placed.faces) and abs(float(place_of(c.geometry)[1] @ axis)) > (
            COAXIAL_COS
        ):
            return c.geometry.rims
    return ()
