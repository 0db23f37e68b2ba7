"""What has to be measured of a part, found from its CAD model as a drafter would dimension it.

Which sizes, from which datum and in which order: docs/characteristics.md.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.cad.compiled import CompiledPart

from ._holes import RoundFeature, diameter_rims, round_features
from ._sheet import across, reading_order, size_text
from ._types import Characteristic, CharacteristicKind, RimGeometry
from .edges import RoundWall, round_walls
from .edges.rims import COAXIAL_COS
from .limits import ToleranceClass, linear_tolerance_mm

SAME_SIZE_MM = 0.01
NOMINAL_DIGITS = 3  # microns: what a mesh knows of its circles
COAXIAL_MM = 0.5  # an axis nearer to its datum is meant to be on it


def derive(
    part: Solid | CompiledPart, tolerance_class: ToleranceClass = "m"
) -> tuple[Characteristic, ...]:
    """Return the characteristics of a part, numbered from 1 in the order of a drawing.

    Parameters
    ----------
    part : its CAD model
    tolerance_class : of ISO 2768-1, for all that has no limits of its own
    """
    solid = part.solid if isinstance(part, CompiledPart) else part
    features = round_features(solid, round_walls(solid))
    found = _of_round_features(solid, features, tolerance_class)
    return tuple(replace(c, balloon=i) for i, c in enumerate(found, start=1))


def _of_round_features(
    solid: Solid, features: Iterable[RoundFeature], tolerance_class: ToleranceClass
) -> list[Characteristic]:
    ordered = sorted(features, key=lambda f: (f.is_hole, reading_order(f.axis, f.centre_mm)))
    ordered = sorted(ordered, key=lambda f: reading_order(f.axis, f.centre_mm)[0])
    names = numbered([feature.name for feature in ordered])
    found = []
    for feature, name in zip(ordered, names, strict=True):
        datum = _datum(solid, feature, ordered)
        for wall in feature.walls:
            step = "" if wall is feature.walls[0] else f" step {size_text(2 * wall.radius_mm)}"
            found += _of_wall(solid, wall, f"{name}{step}", datum, tolerance_class)
    return found


def numbered(names: list[str]) -> list[str]:
    """Return names with ``(1)``, ``(2)`` ... behind those that there are several of."""
    count = Counter(names)
    so_far: Counter[str] = Counter()
    unique = []
    for name in names:
        so_far[name] += 1
        unique.append(f"{name} ({so_far[name]})" if count[name] > 1 else name)
    return unique


def _of_wall(
    solid: Solid,
    wall: RoundWall,
    name: str,
    datum: RoundFeature | None,
    tolerance_class: ToleranceClass,
) -> list[Characteristic]:
    diameter = round(2 * wall.radius_mm, NOMINAL_DIGITS)
    rims = diameter_rims(wall)
    source = f"ISO 2768-{tolerance_class}"
    found = []
    deviation = linear_tolerance_mm(diameter, tolerance_class)
    if deviation is not None:
        found.append(
            Characteristic(
                id=f"{name} diameter",
                balloon=0,
                kind=CharacteristicKind.DIAMETER,
                label=f"{name}, diameter",
                nominal_mm=diameter,
                lower_mm=diameter - deviation,
                upper_mm=diameter + deviation,
                source=source,
                geometry=RimGeometry(rims),
                faces=wall.faces,
            )
        )
    if datum is not None and any(wall is other for other in datum.walls):
        datum = None
    reach = _reach_mm(solid, wall, datum)
    if not wall.is_hole and reach < wall.radius_mm + SAME_SIZE_MM:
        return found  # it is the outline itself
    deviation = linear_tolerance_mm(reach, tolerance_class)
    if deviation is not None:
        whence = f"from {datum.name}" if datum is not None else "from the outline"
        found.append(
            Characteristic(
                id=f"{name} position",
                balloon=0,
                kind=CharacteristicKind.POSITION,
                label=f"{name}, position {whence}",
                nominal_mm=0.0,
                lower_mm=0.0,
                upper_mm=deviation,
                source=source,
                geometry=RimGeometry(rims, datum.rims if datum is not None else ()),
                faces=wall.faces,
            )
        )
    return found


def _datum(
    solid: Solid, feature: RoundFeature, features: Iterable[RoundFeature]
) -> RoundFeature | None:
    """Return the round feature that places are given from along an axis, None for the outline.

    It is the hole or boss that a drawing would choose: the largest of those that are the only ones
    of their size. A pattern of equal holes has no first one, and is placed from the outline.
    """
    parallel = [f for f in features if abs(float(f.axis @ feature.axis)) > COAXIAL_COS]
    sizes = [2 * f.walls[0].radius_mm for f in parallel]
    single = [
        f
        for f, size in zip(parallel, sizes, strict=True)
        if sum(abs(size - other) < SAME_SIZE_MM for other in sizes) == 1
    ]
    return max(single, key=lambda f: f.walls[0].radius_mm, default=None)


def _reach_mm(solid: Solid, wall: RoundWall, datum: RoundFeature | None) -> float:
    """Return the length whose tolerance the place of a wall has.

    It is the distance of its axis from the datum; where both are one axis, its own diameter.
    """
    if datum is not None:
        offset = wall.centre_mm - datum.centre_mm
        away = float(np.linalg.norm(offset - (offset @ wall.axis) * wall.axis))
        return away if away > COAXIAL_MM else 2 * wall.radius_mm
    return max(_to_outline_mm(solid, wall.centre_mm, direction) for direction in across(wall.axis))


def _to_outline_mm(solid: Solid, p_mm: FloatArray, direction: FloatArray) -> float:
    reach = np.asarray(solid.mesh.vertices) @ direction
    at = float(p_mm @ direction)
    return min(at - float(reach.min()), float(reach.max()) - at)
