"""The object on the table to take next; all others are left in place (ADR 66).

The current part is never confused with another one: after a fault, it is sought as the object that
was not there before, and if there are several candidates, a person decides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from controller.cell.compute import Pickable
from controller.cell.errors import PartProblemError
from controller.cell.journal.rows import SightingFields
from messages import joined, key, say

# Objects beside a part that was taken, or dropped next to it, may have been pushed by this much.
PUSHED_MM: Final = 15.0
TURNED_DEG: Final = 8.0  # largest change of an untouched object's angle, by recognition's scatter
FREE_STEP: Final = 0.05  # share of an outline; a smaller difference counts as equally free


@dataclass(frozen=True, slots=True)
class WantedParts:
    """The parts looked for on the table.

    Attributes
    ----------
    names : names of the parts that still have work left; of the part alone that is sought again
    is_sought_again : True if it was on the table, or in a gripper, before
    neighbours : other objects on the table at that time
    serials : serial of the next part by recipe name, where it is known before the part is taken
    scanned : serial read off the latest part; empty for none
    batch : names of all parts of the batch, also those of which enough are done
    """

    names: tuple[str, ...]
    is_sought_again: bool = False
    neighbours: tuple[SightingFields, ...] = ()
    serials: Mapping[str, str] = field(default_factory=dict)
    scanned: str = ""
    batch: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The names, for a message."""
        return " or ".join(self.names)


@dataclass(frozen=True, slots=True)
class LeftAlone:
    """A part that cannot be taken as it lies, and the objects beside it then."""

    one: SightingFields
    beside: tuple[SightingFields, ...]
    reason: str

    def is_it(self, other: SightingFields) -> bool:
        """Return whether an object is this part, unmoved."""
        return (
            (other.part, other.pose_index) == (self.one.part, self.one.pose_index)
            and apart_mm(other, self.one) <= PUSHED_MM
            and apart_deg(other.theta_deg, self.one.theta_deg) <= TURNED_DEG
        )

    def is_freer(self, seen: Sequence[SightingFields]) -> bool:
        """Return whether an object that lay beside it is gone."""
        return any(all(apart_mm(one, before) > PUSHED_MM for one in seen) for before in self.beside)


def candidates(
    seen: Sequence[SightingFields], wanted: WantedParts, left: Sequence[LeftAlone] = ()
) -> tuple[int, ...]:
    """Return the numbers of the objects that may be the part, none of them if it is not there.

    Parameters
    ----------
    seen : all objects on the table
    wanted : object wanted
    left : parts that cannot be taken as they lie; tried again where nothing else is left, and
        something beside them is gone

    Raises
    ------
    PartProblemError : the part is not there but other objects are, or which of several it is
        nobody can know
    """
    new = _without_neighbours(seen, wanted.neighbours) if wanted.is_sought_again else None
    numbers = range(len(seen)) if new is None else new
    found = tuple(k for k in numbers if _may_be_taken(seen[k], wanted.names))
    if not found:
        if len(numbers) > 0:
            raise _none_of_them([seen[k] for k in numbers], wanted)
        return ()
    if wanted.is_sought_again:
        if len(found) > 1:
            raise PartProblemError(
                "many_parts",
                say(
                    "{found_count} objects on the table may be the {words} that was "
                    "lost: {where}; take the others away",
                    found_count=len(found),
                    words=wanted.words,
                    where=where([seen[k] for k in found]),
                ),
            )
        return found
    found = _not_left(seen, found, left)
    if wanted.scanned:
        return _alone(seen, found, wanted)
    return _in_order(seen, found, wanted)


def _not_left(
    seen: Sequence[SightingFields], found: tuple[int, ...], left: Sequence[LeftAlone]
) -> tuple[int, ...]:
    """Return the objects that were not left alone before; if none, those that are freer now."""
    known = {k: next((one for one in left if one.is_it(seen[k])), None) for k in found}
    rest = tuple(k for k in found if known[k] is None)
    again = rest or tuple(k for k, one in known.items() if one is not None and one.is_freer(seen))
    if not again:
        reasons = joined(
            "; ", dict.fromkeys(one.reason for one in known.values() if one is not None)
        )
        raise PartProblemError(
            "no_plan",
            say(
                "nothing on the table can be taken as it lies: {where}: {reasons}",
                where=where(seen),
                reasons=reasons,
            ),
        )
    return again


def _alone(
    seen: Sequence[SightingFields], found: tuple[int, ...], wanted: WantedParts
) -> tuple[int, ...]:
    """Return the one part whose number was read; it must be the only one of the batch."""
    of_batch = [k for k, one in enumerate(seen) if one.part in wanted.batch]
    if len(of_batch) > 1:
        raise PartProblemError(
            "many_parts",
            say(
                "{of_batch_count} parts on the table: {where}; no picture shows "
                "which of them has {scanned}: leave only that one on the table",
                of_batch_count=len(of_batch),
                where=where([seen[k] for k in of_batch]),
                scanned=wanted.scanned,
            ),
        )
    return found


def _in_order(
    seen: Sequence[SightingFields], found: tuple[int, ...], wanted: WantedParts
) -> tuple[int, ...]:
    """Return the parts without those of a numbered name that lies on the table more than once."""
    doubtful = [
        [k for k in found if seen[k].part == name]
        for name in wanted.names
        if name in wanted.serials
    ]
    several = [group for group in doubtful if len(group) > 1]
    dropped = {k for group in several for k in group}
    rest = tuple(k for k in found if k not in dropped)
    if not rest:
        (first, *_) = several
        name = str(seen[first[0]].part)
        raise PartProblemError(
            "many_parts",
            say(
                "{first_count} parts {name} on the table: {where}; no picture "
                "shows which of them has {serials}: put parts with serial numbers "
                "on the table one at a time",
                first_count=len(first),
                name=name,
                where=where([seen[k] for k in first]),
                serials=wanted.serials[name],
            ),
        )
    return rest


def chosen(
    seen: Sequence[SightingFields], among: Sequence[int], pickable: Sequence[Pickable]
) -> int:
    """Return the number of the object to take: known for sure, free of others, soonest done.

    An object under another one is left until the upper one is gone.

    Parameters
    ----------
    seen : all objects on the table
    among : numbers of those that may be taken, at least one
    pickable : grasps that would take each visible object from among the others

    Raises
    ------
    PartProblemError : each of them is too near to something
    """

    def worth(k: int) -> tuple[bool, bool, int, float, float, int]:
        one, how = seen[k], pickable[k]
        freedom = round(one.free_share / FREE_STEP)
        return (
            not one.ambiguous_with,
            one.touching_count == 0,
            freedom,
            -how.forecast_s,
            one.free_share,
            how.path_count,
        )

    free = [k for k in among if pickable[k].path_count > 0 and not seen[k].is_covered]
    if not free:
        raise PartProblemError(
            "many_parts",
            say(
                "{seen_count} objects on the table: {where}; no gripper reaches "
                "{part} between them: move them apart",
                seen_count=len(seen),
                where=where(seen),
                part=seen[among[0]].part,
            ),
        )
    return max(free, key=worth)


def where(seen: Sequence[SightingFields]) -> str:
    """Return the objects and their places, for a message."""
    return joined(
        "; ",
        (
            say(
                "{part} at x {x_mm:.0f}, y {y_mm:.0f} mm",
                part=one.part or key("unknown object"),
                x_mm=one.x_mm,
                y_mm=one.y_mm,
            )
            + (", touching another" if one.touching_count else "")
            + (", lying on another" if one.lies_on else "")
            + (", under another" if one.is_covered else "")
            + (", partly outside the backlit area" if one.is_cut else "")
            for one in seen
        ),
    )


def _may_be_taken(one: SightingFields, names: Sequence[str]) -> bool:
    return one.part in names and one.T_world_part is not None and not one.is_cut


def _without_neighbours(
    seen: Sequence[SightingFields], neighbours: Sequence[SightingFields]
) -> tuple[int, ...]:
    """Return the numbers of the objects that no neighbour of before accounts for, nearest first."""
    pairs = sorted(
        (apart_mm(one, before), k, n)
        for k, one in enumerate(seen)
        for n, before in enumerate(neighbours)
        if before.part is None or one.part is None or before.part == one.part
    )
    accounted: dict[int, int] = {}
    for away_mm, k, n in pairs:
        if away_mm <= PUSHED_MM and k not in accounted and n not in accounted.values():
            accounted[k] = n
    return tuple(k for k in range(len(seen)) if k not in accounted)


def apart_mm(one: SightingFields, other: SightingFields) -> float:
    """Return the distance of two objects [mm]."""
    return float(np.hypot(one.x_mm - other.x_mm, one.y_mm - other.y_mm))


def apart_deg(one_deg: float, other_deg: float) -> float:
    """Return the difference of two angles, 0 to 180."""
    return abs((one_deg - other_deg + 180) % 360 - 180)


def _none_of_them(seen: Sequence[SightingFields], wanted: WantedParts) -> PartProblemError:
    """Return the reason why none of some objects is taken."""
    name = wanted.words
    if len(seen) > 1:
        return PartProblemError(
            "many_parts",
            say(
                "{seen_count} objects on the table, and none is {name} that can be "
                "taken: {where}; lay {name} there, or start with a recipe for one "
                "of them",
                seen_count=len(seen),
                name=name,
                where=where(seen),
            ),
        )
    (one,) = seen
    at = say("at x {x_mm:.0f}, y {y_mm:.0f} mm", x_mm=one.x_mm, y_mm=one.y_mm)
    if one.part is None:
        return PartProblemError(
            "unknown_object",
            say(
                "the object {at}: {reason}; take it away, or check the recipe's `part:`",
                at=at,
                reason=one.reason,
            ),
        )
    if one.is_cut:
        return PartProblemError(
            "part_cut_off",
            say(
                "{part} {at} lies partly outside the backlit area: "
                "{free_percent:.0f} % of its outline is visible; move it inwards and "
                "start again",
                part=one.part,
                at=at,
                free_percent=100 * one.free_share,
            ),
        )
    if one.part in wanted.batch:
        return PartProblemError(
            "wrong_part",
            say(
                "{part} is {at}, and enough of those are done; take it away, and put {name} there",
                part=one.part,
                at=at,
                name=name,
            ),
        )
    return PartProblemError(
        "wrong_part",
        say(
            "{part} is {at}, the recipe is for {name}; put that there, or "
            "start with a recipe for {part}",
            part=one.part,
            at=at,
            name=name,
        ),
    )
