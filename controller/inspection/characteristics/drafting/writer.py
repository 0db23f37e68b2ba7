"""The characteristics of a part, written as a drafter would: which, from which datum, in order.

The rules in words: docs/characteristics.md.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Feature, Solid

from .._types import GENERAL, Characteristic, CharacteristicKind, Geometry, RimGeometry
from ..edges import RoundWall, round_walls
from ..edges.rims import COAXIAL_COS
from ..limits import ToleranceClass, linear_tolerance_mm, radius_tolerance_mm
from .holes import (
    RoundFeature,
    diameter_rims,
    ends_inside,
    inner_faces,
    round_features,
    wall_height_mm,
)
from .planes import PlanePair, plane_pairs
from .rounds import Round, RoundSlot, round_slots, rounds
from .sheet import across, reading_order, size_text

SAME_SIZE_MM = 0.01
NOMINAL_DIGITS = 3  # microns: what a mesh knows of its circles
NO_DEPTH = "no picture shows the depth of a hole"
COAXIAL_MM = 0.5  # an axis nearer to its datum is meant to be on it


def nominal_characteristics(
    solid: Solid, features: tuple[Feature, ...], tolerance_class: ToleranceClass
) -> tuple[Characteristic, ...]:
    """Return the characteristics of a part with general tolerances, numbered from 1.

    Parameters
    ----------
    solid, features : of the part
    tolerance_class : of ISO 2768-1
    """
    walls = round_walls(solid)
    round_ones = round_features(solid, walls)
    chamfered = {i for f in features if f.kind == "chamfer" for i in f.faces}
    inner = inner_faces(solid, round_ones)
    pairs = plane_pairs(solid, inner | chamfered)
    writer = _Writer(tolerance_class)
    found = [
        *writer.of_pairs(p for p in pairs if p.kind == CharacteristicKind.LENGTH),
        *writer.of_round_features(solid, round_ones, inner),
        *writer.of_slots(round_slots(walls, features)),
        *writer.of_pairs(p for p in pairs if p.kind != CharacteristicKind.LENGTH),
        *writer.of_rounds(rounds(solid, walls, features)),
    ]
    return tuple(replace(c, balloon=i) for i, c in enumerate(found, start=1))


def numbered(names: list[str]) -> list[str]:
    """Return names with ``(1)``, ``(2)`` ... behind those that there are several of."""
    count = Counter(names)
    so_far: Counter[str] = Counter()
    unique = []
    for name in names:
        so_far[name] += 1
        unique.append(f"{name} ({so_far[name]})" if count[name] > 1 else name)
    return unique


@dataclass(frozen=True, slots=True)
class _Writer:
    """Writes characteristics with the limits of one class of general tolerances."""

    tolerance_class: ToleranceClass

    def of_round_features(
        self, solid: Solid, features: Iterable[RoundFeature], inner: frozenset[int]
    ) -> list[Characteristic]:
        ordered = sorted(features, key=lambda f: (f.is_hole, reading_order(f.axis, f.centre_mm)))
        ordered = sorted(ordered, key=lambda f: reading_order(f.axis, f.centre_mm)[0])
        names = numbered([feature.name for feature in ordered])
        found = []
        for feature, name in zip(ordered, names, strict=True):
            datum = _datum(feature, ordered)
            for wall in feature.walls:
                step = "" if wall is feature.walls[0] else f" step {size_text(2 * wall.radius_mm)}"
                found += self._of_wall(solid, wall, f"{name}{step}", datum)
                if wall.is_hole and ends_inside(solid, wall, inner):
                    found += self._depth(solid, wall, f"{name}{step} depth")
        return found

    def of_slots(self, slots: Iterable[RoundSlot]) -> list[Characteristic]:
        ordered = sorted(slots, key=lambda s: reading_order(s.axis, s.rims[0].centre_mm))
        names = numbered([f"slot {s.width_mm:g} x {size_text(s.length_mm)}" for s in ordered])
        return [
            characteristic
            for slot, name in zip(ordered, names, strict=True)
            for characteristic in self._sized(
                CharacteristicKind.LENGTH,
                f"{name} length",
                slot.length_mm,
                RimGeometry(slot.rims),
                slot.faces,
            )
        ]

    def of_pairs(self, pairs: Iterable[PlanePair]) -> list[Characteristic]:
        found = []
        for pair in pairs:
            faces = pair.geometry.one_face, pair.geometry.other_face
            name = f"{pair.word} {size_text(pair.distance_mm)} F{min(faces)} to F{max(faces)}"
            found += [
                replace(c, exempt=pair.hidden, is_measured=not pair.hidden)
                for c in self._sized(pair.kind, name, pair.distance_mm, pair.geometry, faces)
            ]
        return found

    def of_rounds(self, arcs: Iterable[Round]) -> list[Characteristic]:
        ordered = sorted(arcs, key=lambda r: reading_order(r.rims[0].axis, r.rims[0].centre_mm))
        names = numbered([f"{r.name} R{size_text(r.wall.radius_mm)}" for r in ordered])
        found = []
        for each, name in zip(ordered, names, strict=True):
            radius = round(each.wall.radius_mm, NOMINAL_DIGITS)
            deviation = radius_tolerance_mm(radius, self.tolerance_class)
            if deviation is not None:
                found.append(
                    self._characteristic(
                        CharacteristicKind.RADIUS,
                        f"{name} radius",
                        radius,
                        (max(radius - deviation, 0.0), radius + deviation),
                        RimGeometry(each.rims),
                        each.wall.faces,
                    )
                )
        return found

    def _of_wall(
        self, solid: Solid, wall: RoundWall, name: str, datum: RoundFeature | None
    ) -> list[Characteristic]:
        rims = diameter_rims(wall)
        found = self._sized(
            CharacteristicKind.DIAMETER,
            f"{name} diameter",
            2 * wall.radius_mm,
            RimGeometry(rims),
            wall.faces,
        )
        if datum is not None and any(wall is other for other in datum.walls):
            datum = None
        reach = _reach_mm(solid, wall, datum)
        if not wall.is_hole and reach < wall.radius_mm + SAME_SIZE_MM:
            return found  # it is the outline itself
        deviation = linear_tolerance_mm(reach, self.tolerance_class)
        if deviation is not None:
            whence = f"from {datum.name}" if datum is not None else "from the outline"
            found.append(
                self._characteristic(
                    CharacteristicKind.POSITION,
                    f"{name} position",
                    0.0,
                    (0.0, deviation),
                    RimGeometry(rims, datum.rims if datum is not None else ()),
                    wall.faces,
                    label=f"{name}, position {whence}",
                    length_mm=reach,
                )
            )
        return found

    def _depth(self, solid: Solid, wall: RoundWall, name: str) -> list[Characteristic]:
        depth_mm = wall_height_mm(solid, wall)
        geometry = RimGeometry(diameter_rims(wall))
        sized = self._sized(CharacteristicKind.DISTANCE, name, depth_mm, geometry, wall.faces)
        return [replace(c, exempt=NO_DEPTH, is_measured=False) for c in sized]

    def _sized(
        self,
        kind: CharacteristicKind,
        name: str,
        size_mm: float,
        geometry: Geometry,
        faces: tuple[int, ...],
    ) -> list[Characteristic]:
        """Return the characteristic of a size; none where the class has no tolerance for it."""
        nominal = round(size_mm, NOMINAL_DIGITS)
        deviation = linear_tolerance_mm(nominal, self.tolerance_class)
        if deviation is None:
            return []
        limits = nominal - deviation, nominal + deviation
        return [self._characteristic(kind, name, nominal, limits, geometry, faces)]

    def _characteristic(
        self,
        kind: CharacteristicKind,
        name: str,
        nominal_mm: float,
        limits_mm: tuple[float, float],
        geometry: Geometry,
        faces: tuple[int, ...],
        label: str = "",
        length_mm: float = 0.0,
    ) -> Characteristic:
        word = f" {kind.value}"
        return Characteristic(
            id=name,
            balloon=0,
            kind=kind,
            label=label or (f"{name.removesuffix(word)},{word}" if name.endswith(word) else name),
            nominal_mm=nominal_mm,
            lower_mm=round(limits_mm[0], NOMINAL_DIGITS),
            upper_mm=round(limits_mm[1], NOMINAL_DIGITS),
            source=f"{GENERAL}{self.tolerance_class}",
            geometry=geometry,
            faces=faces,
            length_mm=length_mm,
        )


def pair_characteristic(pair: PlanePair, tolerance_class: ToleranceClass) -> Characteristic | None:
    """Return the characteristic of one distance, None where the class has no tolerance for it.

    Parameters
    ----------
    pair : two planes
    tolerance_class : of ISO 2768-1
    """
    return next(iter(_Writer(tolerance_class).of_pairs([pair])), None)


def _datum(feature: RoundFeature, features: Iterable[RoundFeature]) -> RoundFeature | None:
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
