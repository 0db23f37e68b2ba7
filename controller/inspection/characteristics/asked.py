"""Entries of a recipe or a set of views on characteristics: own limits, additions, exclusions.

An entry names characteristics by their names in the list, by faces, or by kind and place.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.cad.compiled import CompiledPart
from messages import say

from ._types import Characteristic, CharacteristicKind, RimGeometry, place_of
from .derive import derive
from .drafting import between, pair_characteristic
from .limits import ToleranceClass, fit_limits_mm

NEAR_MM: Final = 1.0  # largest distance of a given place from the axis or edges that it means
SAME_SIZE: Final = 0.1  # largest difference of a given size, as a share of the nominal one
PARALLEL_COS: Final = float(np.cos(np.radians(5.0)))
MAX_CLOSE_NAMES: Final = 3
LEFT_OUT: Final = "left out by the "
_NUMBER = re.compile(r" \(\d+\)")


class AskedError(ValueError):
    """An entry names something that the part lacks, or is inconsistent."""

    def __init__(self, index: int, problem: str) -> None:
        super().__init__(problem)
        self.index = index


@dataclass(frozen=True, eq=False, slots=True)
class Asked:
    """One entry of a list of characteristics.

    Attributes
    ----------
    name : id of a characteristic; without the number, of all alike; without the kind, of a feature
    faces : ids of the faces of a round feature, or of the two planes of a distance
    kind : kind asked for; None for the kind in the name
    p_part_mm, axis : (3,) place and axis or direction in the CAD frame, where no name is given
    nominal_mm : nominal value; None for that of the CAD model
    lower_mm, upper_mm : limits of the value
    plus_mm, minus_mm : permitted deviations above and below the nominal value
    fit : tolerance class, such as ``H7``
    is_critical : True if two independent looks must agree, whatever the drawing states
    ignore : reason for leaving it out; empty where it is not
    source : origin of the entry, such as ``recipe``
    """

    name: str = ""
    faces: tuple[int, ...] = ()
    kind: CharacteristicKind | None = None
    p_part_mm: FloatArray | None = None
    axis: FloatArray | None = None
    nominal_mm: float | None = None
    lower_mm: float | None = None
    upper_mm: float | None = None
    plus_mm: float | None = None
    minus_mm: float | None = None
    fit: str = ""
    is_critical: bool = False
    ignore: str = ""
    source: str = "recipe"

    @property
    def has_limits(self) -> bool:
        """True if it states limits or a nominal value of its own."""
        numbers = self.lower_mm, self.upper_mm, self.plus_mm, self.minus_mm, self.nominal_mm
        return bool(self.fit) or any(number is not None for number in numbers)


def characteristics_of(
    part: Solid | CompiledPart,
    tolerance_class: ToleranceClass = "m",
    given: Sequence[Asked] | None = None,
    changes: Sequence[Asked] = (),
) -> tuple[Characteristic, ...]:
    """Return the characteristics to measure on a part.

    Parameters
    ----------
    part : its CAD model
    tolerance_class : class of ISO 2768-1, for characteristics without limits of their own
    given : the only ones to measure, in this order; None for all that follow from the CAD model
    changes : limits, exclusions and added distances of the recipe

    Raises
    ------
    AskedError : an entry names something that the part lacks, or has inconsistent limits; the error
        gives its index in `changes`, then in `given`
    """
    solid = part.solid if isinstance(part, CompiledPart) else part
    known = list(derive(part, tolerance_class))
    for i, asked in enumerate(changes):
        for at in _found(solid, known, asked, i, tolerance_class):
            known[at] = _changed(known[at], asked, i)
    if given is None:
        return _numbered(known)
    chosen = []
    for i, asked in enumerate(given, start=len(changes)):
        for at in _found(solid, known, asked, i, tolerance_class):
            one = _changed(known[at], asked, i)
            is_new_name = asked.p_part_mm is not None and asked.name
            chosen.append(replace(one, id=asked.name) if is_new_name else one)
    return _numbered(chosen)


def _numbered(characteristics: Sequence[Characteristic]) -> tuple[Characteristic, ...]:
    return tuple(replace(c, balloon=i) for i, c in enumerate(characteristics, start=1))


def _found(
    solid: Solid,
    known: list[Characteristic],
    asked: Asked,
    index: int,
    tolerance_class: ToleranceClass,
) -> list[int]:
    """Return the indices of the known characteristics that an entry means; may add a distance."""
    if asked.faces:
        return _by_faces(solid, known, asked, index, tolerance_class)
    if asked.p_part_mm is not None:
        return [_by_place(known, asked, index)]
    names: dict[str, list[int]] = {}
    for at, characteristic in enumerate(known):
        for name in _names(characteristic):
            names.setdefault(name, []).append(at)
    wanted = " ".join(asked.name.lower().split())
    found = names.get(wanted, [])
    if asked.kind is not None:
        found = [at for at in found if known[at].kind == asked.kind]
    if not found:
        near = difflib.get_close_matches(wanted, names, n=MAX_CLOSE_NAMES, cutoff=0.4)
        nearest = say("; nearest: {near}", near=", ".join(near)) if near else ""
        raise AskedError(
            index,
            say(
                "no characteristic {name} on the part{nearest}",
                name=repr(asked.name),
                nearest=nearest,
            ),
        )
    kinds = {known[at].kind for at in found}
    if asked.has_limits and len(kinds) > 1:
        words = ", ".join(sorted(f"`{wanted} {kind}`" for kind in kinds))
        raise AskedError(
            index,
            say(
                "{name} has several characteristics; write one of {words}",
                name=repr(asked.name),
                words=words,
            ),
        )
    return found


def _names(characteristic: Characteristic) -> set[str]:
    """Return the possible names of a characteristic, in lower case."""
    full = characteristic.id.lower()
    feature = full.removesuffix(say(" {value}", value=characteristic.kind.value))
    return {full, feature, _NUMBER.sub("", full), _NUMBER.sub("", feature)}


def _by_faces(
    solid: Solid,
    known: list[Characteristic],
    asked: Asked,
    index: int,
    tolerance_class: ToleranceClass,
) -> list[int]:
    count = len(solid.faces)
    wrong = [i for i in asked.faces if not 0 <= i < count]
    if wrong:
        raise AskedError(
            index,
            say(
                "no face F{wrong} on the part, which has F0 to F{last}",
                wrong=wrong[0],
                last=count - 1,
            ),
        )
    wanted = set(asked.faces)
    found = [
        at
        for at, c in enumerate(known)
        if (wanted <= set(c.faces) or wanted == _planes(c))
        and (asked.kind is None or c.kind == asked.kind)
    ]
    if found:
        # Prefer the measured characteristics of the faces, if there are any.
        return [at for at in found if known[at].is_measured] or found
    names = " and ".join(f"F{i}" for i in asked.faces)
    if len(asked.faces) == 2:
        pair = between(solid, *asked.faces)
        if pair is not None:
            known.append(pair_characteristic(pair, tolerance_class))
            return [len(known) - 1]
    raise AskedError(
        index,
        say("{names}: no characteristic is of these faces, nor are they parallel", names=names),
    )


def _planes(characteristic: Characteristic) -> set[int]:
    """Return the two planes that a distance lies between; none for any other characteristic."""
    geometry = characteristic.geometry
    if isinstance(geometry, RimGeometry):
        return set()
    return {geometry.one_face, geometry.other_face}


def _by_place(known: list[Characteristic], asked: Asked, index: int) -> int:
    assert asked.p_part_mm is not None
    best: tuple[bool, float, int] | None = None
    for at, characteristic in enumerate(known):
        if asked.kind is not None and characteristic.kind != asked.kind:
            continue
        away = _distance_mm(characteristic, asked.p_part_mm, asked.axis)
        nominal, wanted = characteristic.nominal_mm, asked.nominal_mm
        if wanted is not None and abs(nominal - wanted) > SAME_SIZE * max(abs(nominal), 1.0):
            continue
        cost = away + (abs(nominal - wanted) if wanted is not None else 0.0)
        rank = not characteristic.is_measured, cost, at
        if away <= NEAR_MM and (best is None or rank < best):
            best = rank
    if best is None:
        place = ", ".join(f"{v:.2f}" for v in asked.p_part_mm)
        what = asked.kind.value if asked.kind is not None else "characteristic"
        raise AskedError(
            index,
            say(
                "no {what} within {near_mm:g} mm of ({place}) on the part",
                what=what,
                near_mm=NEAR_MM,
                place=place,
            ),
        )
    return best[2]


def _distance_mm(
    characteristic: Characteristic, p_mm: FloatArray, axis: FloatArray | None
) -> float:
    """Return the distance of a point from a characteristic's rim axis, or from its edges."""
    geometry = characteristic.geometry
    middle, own = place_of(geometry)
    if axis is not None and abs(float(axis @ own)) < PARALLEL_COS * float(np.linalg.norm(axis)):
        return float("inf")
    if isinstance(geometry, RimGeometry):
        points = np.array([rim.centre_mm for rim in geometry.rims])
        offset = p_mm - middle
        beside = float(np.linalg.norm(offset - (offset @ own) * own))
        along, at = points @ own, float(p_mm @ own)
        return beside + max(0.0, float(along.min()) - at, at - float(along.max()))
    lines, rims = (*geometry.one, *geometry.other), (*geometry.one_rims, *geometry.other_rims)
    ends = [p for line in lines for p in (line.start_mm, line.end_mm)]
    points = np.array([middle, *ends, *(rim.centre_mm for rim in rims)])
    low, high = points.min(axis=0), points.max(axis=0)
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(low - p_mm, p_mm - high))))


def _changed(characteristic: Characteristic, asked: Asked, index: int) -> Characteristic:
    if asked.ignore:
        exempt = say("left out by the {source}: {ignore}", source=asked.source, ignore=asked.ignore)
        return replace(characteristic, exempt=exempt, is_measured=False)
    critical = asked.is_critical or characteristic.is_critical
    characteristic = replace(characteristic, is_critical=critical)
    if not asked.has_limits:
        return characteristic
    old = characteristic.nominal_mm
    nominal = old if asked.nominal_mm is None else asked.nominal_mm
    lower, upper = characteristic.lower_mm, characteristic.upper_mm
    if not characteristic.is_one_sided:
        lower, upper = lower + nominal - old, upper + nominal - old
    if asked.fit:
        try:
            deviations = fit_limits_mm(asked.fit, nominal)
        except ValueError as error:
            raise AskedError(index, str(error)) from error
        lower, upper = nominal + deviations[0], nominal + deviations[1]
    lower = nominal - asked.minus_mm if asked.minus_mm is not None else lower
    upper = nominal + asked.plus_mm if asked.plus_mm is not None else upper
    lower = asked.lower_mm if asked.lower_mm is not None else lower
    upper = asked.upper_mm if asked.upper_mm is not None else upper
    if lower > upper:
        raise AskedError(
            index,
            say(
                "the lower limit {lower:g} mm is above the upper one, {upper:g} mm",
                lower=lower,
                upper=upper,
            ),
        )
    states = asked.fit or any(
        v is not None for v in (asked.lower_mm, asked.upper_mm, asked.plus_mm, asked.minus_mm)
    )
    source = (
        (say("{source} {fit}", source=asked.source, fit=asked.fit) if asked.fit else asked.source)
        if states
        else characteristic.source
    )
    changed = characteristic.as_stated() if states else characteristic
    return replace(changed, nominal_mm=nominal, lower_mm=lower, upper_mm=upper, source=source)
