"""The characteristics of a part, written as a drafter would: which, from which datum, in order.

The rules in words: docs/characteristics.md.
"""

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Sequence
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
        *writer.of_rounds(rounds(walls, features)),
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
        datums = _datums(ordered)
        outline = _Outline(solid)
        for feature, name, datum in zip(ordered, names, datums, strict=True):
            for wall in feature.walls:
                step = "" if wall is feature.walls[0] else f" step {size_text(2 * wall.radius_mm)}"
                found += self._of_wall(outline, wall, f"{name}{step}", datum)
                if wall.is_hole and ends_inside(solid, wall, inner):
                    found += self._depth(wall, f"{name}{step} depth")
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
        self, outline: "_Outline", wall: RoundWall, name: str, datum: RoundFeature | None
    ) -> list[Characteristic]:
        rims = diameter_rims(wall)
        found = self._sized(
            CharacteristicKind.DIAMETER,
            f"{name} diameter",
            2 * wall.radius_mm,
            RimGeometry(rims),
            wall.faces,
        )
        if datum is not None and wall is datum.walls[0]:
            datum = None
        reach = outline.reach_mm(wall, datum)
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
                    RimGeometry(rims, diameter_rims(datum.walls[0]) if datum is not None else ()),
                    wall.faces,
                    label=f"{name}, position {whence}",
                    length_mm=reach,
                )
            )
        return found

    def _depth(self, wall: RoundWall, name: str) -> list[Characteristic]:
        geometry = RimGeometry(diameter_rims(wall))
        sized = self._sized(CharacteristicKind.DISTANCE, name, wall.height_mm, geometry, wall.faces)
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


def _datums(features: Sequence[RoundFeature]) -> list[RoundFeature | None]:
    """Return for each feature the one that its place is given from, None for the outline.

    It is the hole or boss that a drawing would choose: of those along the same axis the largest
    that is the only one of its size. A pattern of equal holes has no first one, and is placed from
    the outline.
    """
    datums: list[RoundFeature | None] = [None] * len(features)
    todo = list(range(len(features)))
    while todo:
        axis = features[todo[0]].axis
        parallel = [i for i in todo if abs(float(features[i].axis @ axis)) > COAXIAL_COS]
        todo = [i for i in todo if i not in set(parallel)]
        sizes = sorted(2 * features[i].walls[0].radius_mm for i in parallel)
        single = [i for i in parallel if _is_single(sizes, 2 * features[i].walls[0].radius_mm)]
        if single:
            largest = max(single, key=lambda i: features[i].walls[0].radius_mm)
            for i in parallel:
                datums[i] = features[largest]
    return datums


def _is_single(sizes: Sequence[float], size: float) -> bool:
    """Return whether sorted sizes have a size once."""
    return bisect_left(sizes, size + SAME_SIZE_MM) - bisect_right(sizes, size - SAME_SIZE_MM) == 1


class _Outline:
    """How far a part reaches, direction by direction."""

    def __init__(self, solid: Solid) -> None:
        self._vertices = np.asarray(solid.mesh.vertices)
        self._reach: dict[tuple[float, ...], tuple[float, float]] = {}

    def reach_mm(self, wall: RoundWall, datum: RoundFeature | None) -> float:
        """Return the length whose tolerance the place of a wall has.

        It is the distance of its axis from the datum; where both are one axis, its own diameter.
        """
        if datum is not None:
            offset = wall.centre_mm - datum.centre_mm
            away = float(np.linalg.norm(offset - (offset @ wall.axis) * wall.axis))
            return away if away > COAXIAL_MM else 2 * wall.radius_mm
        return max(self._to_side_mm(wall.centre_mm, way) for way in across(wall.axis))

    def _to_side_mm(self, p_mm: FloatArray, direction: FloatArray) -> float:
        key = tuple(direction.tolist())
        if key not in self._reach:
            reach = self._vertices @ direction
            self._reach[key] = float(reach.min()), float(reach.max())
        (low, high), at = self._reach[key], float(p_mm @ direction)
        return min(at - low, high - at)
