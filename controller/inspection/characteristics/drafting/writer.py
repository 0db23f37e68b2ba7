"""Characteristics of a part as a drafter would give them: choice, datums, order.

The rules in words: docs/characteristics.md.
"""

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Feature, Solid
from messages import Message, joined, key, say

from .._types import (
    GENERAL,
    Characteristic,
    CharacteristicKind,
    Geometry,
    RimGeometry,
    place_of,
)
from ..edges import RoundWall, round_walls
from ..edges.rims import COAXIAL_COS
from ..limits import ToleranceClass, linear_tolerance_mm, radius_tolerance_mm
from .depths import Depth, depths
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
from .unmeasured import NO_DEPTH, Unmeasured, recess_name, unmeasured

SAME_SIZE_MM = 0.01
NOMINAL_DIGITS = 3  # decimals of a nominal value; circles of a mesh are good to microns
FROM_OUTLINE: Final = key("from the outline")
COAXIAL_MM = 0.5  # distance below which an axis is meant to coincide with its datum


def nominal_characteristics(
    solid: Solid, features: tuple[Feature, ...], tolerance_class: ToleranceClass
) -> tuple[Characteristic, ...]:
    """Return a part's characteristics with general tolerances, numbered from 1.

    Parameters
    ----------
    solid, features : solid and features of the part
    tolerance_class : class of ISO 2768-1
    """
    walls = round_walls(solid)
    round_ones = round_features(solid, walls)
    chamfered = {i for f in features if f.kind == "chamfer" for i in f.faces}
    inner = inner_faces(solid, round_ones)
    deep = depths(solid, walls)
    floors = frozenset(floor for one in deep for floor in one.floors)
    pairs = plane_pairs(solid, inner | chamfered | floors)
    writer = _Writer(tolerance_class)
    found = [
        *writer.of_pairs(p for p in pairs if p.kind == CharacteristicKind.LENGTH),
        *writer.of_round_features(solid, round_ones, inner, deep),
        *writer.of_slots(solid, round_slots(walls, features)),
        *writer.of_pairs(p for p in pairs if p.kind != CharacteristicKind.LENGTH),
        *writer.of_rounds(rounds(walls, features)),
    ]
    found += writer.of_depths(deep, features, found)
    found += writer.of_unmeasured(unmeasured(solid, features, walls, found))
    return tuple(replace(c, balloon=i) for i, c in enumerate(found, start=1))


# Labels by the templates of names: with a comma before the kind.
LABELS: Final[Mapping[str, str]] = {
    "{name} diameter": key("{name}, diameter"),
    "{name} length": key("{name}, length"),
    "{name} position": key("{name}, position"),
    "{name} radius": key("{name}, radius"),
    "{name} {word}": key("{name}, {word}"),
}
# Names of the sizes between two planes, by what they are.
PAIR_NAMES: Final[Mapping[str, str]] = {
    "length": key("length {size} F{face} to F{other}"),
    "step": key("step {size} F{face} to F{other}"),
    "thickness": key("thickness {size} F{face} to F{other}"),
    "width": key("width {size} F{face} to F{other}"),
}


def numbered(names: list[str]) -> list[str]:
    """Return names with ``(1)``, ``(2)`` and so on appended to repeated ones."""
    count = Counter(names)
    so_far: Counter[str] = Counter()
    unique = []
    for name in names:
        so_far[name] += 1
        unique.append(
            say("{name} ({so_far})", name=name, so_far=so_far[name]) if count[name] > 1 else name
        )
    return unique


@dataclass(frozen=True, slots=True)
class _Writer:
    """Writer of characteristics with general tolerances of one class."""

    tolerance_class: ToleranceClass

    def of_round_features(
        self,
        solid: Solid,
        features: Iterable[RoundFeature],
        inner: frozenset[int],
        deep: Sequence[Depth],
    ) -> list[Characteristic]:
        depth_of = {wall: one for one in deep for wall in one.walls}
        ordered = sorted(features, key=lambda f: (f.is_hole, reading_order(f.axis, f.centre_mm)))
        ordered = sorted(ordered, key=lambda f: reading_order(f.axis, f.centre_mm)[0])
        names = numbered([feature.name for feature in ordered])
        found = []
        datums = _datums(ordered)
        outline = _Outline(solid)
        for feature, name, datum in zip(ordered, names, datums, strict=True):
            for wall in feature.walls:
                step = (
                    ""
                    if wall is feature.walls[0]
                    else say(" step {size_text}", size_text=size_text(2 * wall.radius_mm))
                )
                found += self._of_wall(outline, wall, joined("", (name, step)), datum)
                if wall.is_hole and ends_inside(solid, wall, inner):
                    depth = depth_of.get(wall.faces[0])
                    found.append(
                        self._depth(wall, say("{name}{step} depth", name=name, step=step), depth)
                    )
        return found

    def of_slots(self, solid: Solid, slots: Iterable[RoundSlot]) -> list[Characteristic]:
        ordered = sorted(slots, key=lambda s: reading_order(s.axis, s.rims[0].centre_mm))
        names = numbered(
            [
                say(
                    "{word} {width_mm:g} x {size_text}",
                    word=s.word,
                    width_mm=s.width_mm,
                    size_text=size_text(s.length_mm),
                )
                for s in ordered
            ]
        )
        outline = _Outline(solid)
        found = []
        for slot, name in zip(ordered, names, strict=True):
            geometry = RimGeometry(slot.rims)
            middle, _ = place_of(geometry)
            found += [
                self._sized(
                    CharacteristicKind.LENGTH,
                    say("{name} length", name=name),
                    slot.length_mm,
                    geometry,
                    slot.faces,
                ),
                self._placed(
                    name, outline.to_sides_mm(middle, slot.axis), FROM_OUTLINE, geometry, slot.faces
                ),
            ]
        return found

    def of_pairs(self, pairs: Iterable[PlanePair]) -> list[Characteristic]:
        found = []
        for pair in pairs:
            faces = pair.geometry.one_face, pair.geometry.other_face
            name = say(
                PAIR_NAMES[pair.word],
                size=size_text(pair.distance_mm),
                face=min(faces),
                other=max(faces),
            )
            sized = self._sized(pair.kind, name, pair.distance_mm, pair.geometry, faces)
            found.append(_left_out(sized, pair.hidden) if pair.hidden else sized)
        return found

    def of_rounds(self, arcs: Iterable[Round]) -> list[Characteristic]:
        ordered = sorted(arcs, key=lambda r: reading_order(r.rims[0].axis, r.rims[0].centre_mm))
        names = numbered(
            [
                say("{name} R{size_text}", name=r.name, size_text=size_text(r.wall.radius_mm))
                for r in ordered
            ]
        )
        return [
            self._sized(
                CharacteristicKind.RADIUS,
                say("{name} radius", name=name),
                each.wall.radius_mm,
                RimGeometry(each.rims),
                each.wall.faces,
            )
            for each, name in zip(ordered, names, strict=True)
        ]

    def of_depths(
        self, deep: Sequence[Depth], features: Sequence[Feature], known: Sequence[Characteristic]
    ) -> list[Characteristic]:
        """Return the depths of slots and pockets; those of holes are known."""
        geometries = {id(c.geometry) for c in known}
        rest = [one for one in deep if id(one.geometry) not in geometries]
        names = numbered(
            [say("{recess_name} depth", recess_name=_recess_name(one, features)) for one in rest]
        )
        return [
            self._sized(
                CharacteristicKind.DISTANCE,
                name,
                one.depth_mm,
                one.geometry,
                (one.geometry.one_face, one.geometry.other_face),
            )
            for one, name in zip(rest, names, strict=True)
        ]

    def of_unmeasured(self, sizes: Iterable[Unmeasured]) -> list[Characteristic]:
        return [
            _left_out(self._sized(u.kind, u.name, u.size_mm, u.geometry, u.faces), u.reason)
            for u in sizes
        ]

    def _of_wall(
        self, outline: "_Outline", wall: RoundWall, name: str, datum: RoundFeature | None
    ) -> list[Characteristic]:
        rims = diameter_rims(wall)
        found = [
            self._sized(
                CharacteristicKind.DIAMETER,
                say("{name} diameter", name=name),
                2 * wall.radius_mm,
                RimGeometry(rims),
                wall.faces,
            )
        ]
        if datum is not None and wall is datum.walls[0]:
            datum = None
        reach = outline.reach_mm(wall, datum)
        if not wall.is_hole and reach < wall.radius_mm + SAME_SIZE_MM:
            return found  # the outline itself
        whence = say("from {name}", name=datum.name) if datum is not None else FROM_OUTLINE
        geometry = RimGeometry(rims, diameter_rims(datum.walls[0]) if datum is not None else ())
        return [*found, self._placed(name, reach, whence, geometry, wall.faces)]

    def _depth(self, wall: RoundWall, name: str, depth: Depth | None) -> Characteristic:
        """Return the depth of a hole; unmeasured where its mouth is not plane."""
        kind = CharacteristicKind.DISTANCE
        if depth is not None:
            faces = (*wall.faces, *sorted(depth.floors))
            return self._sized(kind, name, depth.depth_mm, depth.geometry, faces)
        geometry = RimGeometry(diameter_rims(wall))
        return _left_out(self._sized(kind, name, wall.height_mm, geometry, wall.faces), NO_DEPTH)

    def _placed(
        self,
        name: str,
        reach_mm: float,
        whence: str,
        geometry: RimGeometry,
        faces: tuple[int, ...],
    ) -> Characteristic:
        """Return the position of an axis, with the tolerance of the corresponding length."""
        deviation = linear_tolerance_mm(reach_mm, self.tolerance_class)
        placed = self._characteristic(
            CharacteristicKind.POSITION,
            say("{name} position", name=name),
            0.0,
            (0.0, deviation or 0.0),
            geometry,
            faces,
            label=say("{name}, position {whence}", name=name, whence=whence),
            length_mm=reach_mm,
        )
        return placed if deviation is not None else self._without_tolerance(placed, reach_mm)

    def _sized(
        self,
        kind: CharacteristicKind,
        name: str,
        size_mm: float,
        geometry: Geometry,
        faces: tuple[int, ...],
    ) -> Characteristic:
        """Return the characteristic of a size; unmeasured where the class has no tolerance."""
        nominal = round(size_mm, NOMINAL_DIGITS)
        table = radius_tolerance_mm if kind is CharacteristicKind.RADIUS else linear_tolerance_mm
        deviation = table(nominal, self.tolerance_class)
        limits = max(nominal - (deviation or 0.0), 0.0), nominal + (deviation or 0.0)
        sized = self._characteristic(kind, name, nominal, limits, geometry, faces)
        return sized if deviation is not None else self._without_tolerance(sized, nominal)

    def _without_tolerance(self, one: Characteristic, size_mm: float) -> Characteristic:
        why = say(
            "{general}{tolerance_class} has no tolerance for {size_text}",
            general=GENERAL,
            tolerance_class=self.tolerance_class,
            size_text=size_text(size_mm),
        )
        return _left_out(one, why)

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
        return Characteristic(
            id=name,
            balloon=0,
            kind=kind,
            label=label or _label(kind, name),
            nominal_mm=nominal_mm,
            lower_mm=round(limits_mm[0], NOMINAL_DIGITS),
            upper_mm=round(limits_mm[1], NOMINAL_DIGITS),
            source=f"{GENERAL}{self.tolerance_class}",
            geometry=geometry,
            faces=faces,
            length_mm=length_mm,
        )


def _label(kind: CharacteristicKind, name: str) -> str:
    """Return a name with a comma before the kind that it ends with, unless it is numbered."""
    if isinstance(name, Message) and name.key in LABELS and name.endswith(f" {kind.value}"):
        return Message(LABELS[name.key], name.values)
    return name


def _recess_name(depth: Depth, features: Sequence[Feature]) -> str:
    own = (f for f in features if f.across and depth.walls & set(f.faces))
    feature = next(own, None)
    return (
        say("recess F{one_face}", one_face=depth.geometry.one_face)
        if feature is None
        else recess_name(feature)
    )


def _left_out(one: Characteristic, reason: str) -> Characteristic:
    return replace(one, exempt=reason, is_measured=False)


def pair_characteristic(pair: PlanePair, tolerance_class: ToleranceClass) -> Characteristic:
    """Return the characteristic of a distance.

    Parameters
    ----------
    pair : the two planes
    tolerance_class : class of ISO 2768-1
    """
    return _Writer(tolerance_class).of_pairs([pair])[0]


def _datums(features: Sequence[RoundFeature]) -> list[RoundFeature | None]:
    """Return the datum feature of each feature's position; None for the outline.

    The datum is the hole or boss that a drawing would choose: the largest along the same axis that
    is the only one of its size. A pattern of equal holes has no distinguished one, and is placed
    from the outline.
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
    """Return True if sorted sizes contain a size exactly once."""
    return bisect_left(sizes, size + SAME_SIZE_MM) - bisect_right(sizes, size - SAME_SIZE_MM) == 1


class _Outline:
    """Extent of a part, direction by direction."""

    def __init__(self, solid: Solid) -> None:
        self._vertices = np.asarray(solid.mesh.vertices)
        self._reach: dict[tuple[float, ...], tuple[float, float]] = {}

    def reach_mm(self, wall: RoundWall, datum: RoundFeature | None) -> float:
        """Return the length whose tolerance applies to the position of a wall.

        It is the distance of the wall's axis from the datum; for coincident axes, the diameter.
        """
        if datum is not None:
            offset = wall.centre_mm - datum.centre_mm
            away = float(np.linalg.norm(offset - (offset @ wall.axis) * wall.axis))
            return away if away > COAXIAL_MM else 2 * wall.radius_mm
        return self.to_sides_mm(wall.centre_mm, wall.axis)

    def to_sides_mm(self, p_mm: FloatArray, axis: FloatArray) -> float:
        """Return the larger of an axis's distances from the nearest sides of the part."""
        return max(self._to_side_mm(p_mm, way) for way in across(axis))

    def _to_side_mm(self, p_mm: FloatArray, direction: FloatArray) -> float:
        key = tuple(direction.tolist())
        if key not in self._reach:
            reach = self._vertices @ direction
            self._reach[key] = float(reach.min()), float(reach.max())
        (low, high), at = self._reach[key], float(p_mm @ direction)
        return min(at - low, high - at)
