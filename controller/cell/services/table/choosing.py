"""Which object on the table is the part to go on with; all others are left where they are (ADR 66).

A part at hand is never mixed up with another one: sought again after a fault it is what was not
there before, and where several may be it, a person decides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.cell.errors import PartProblemError
from controller.cell.journal.rows import SightingFields

# What stood beside a part that was taken, or dropped next to it, may have been pushed by so much.
PUSHED_MM: Final = 15.0


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is looked for on the table.

    Attributes
    ----------
    name : of the recipe's part
    is_sought_again : it was on the table, or in a gripper, before
    neighbours : what else was on the table then
    serial : that this part is to have; empty for none
    """

    name: str
    is_sought_again: bool = False
    neighbours: tuple[SightingFields, ...] = ()
    serial: str = ""


def candidates(seen: Sequence[SightingFields], wanted: Wanted) -> tuple[int, ...]:
    """Return the numbers of the objects that may be the part, none of them if it is not there.

    Parameters
    ----------
    seen : all objects on the table
    wanted : what is looked for

    Raises
    ------
    PartProblemError : the part is not there but other objects are, or which of several it is
        nobody can know
    """
    new = _without_neighbours(seen, wanted.neighbours) if wanted.is_sought_again else None
    numbers = range(len(seen)) if new is None else new
    found = tuple(k for k in numbers if _may_be_taken(seen[k], wanted.name))
    if not found:
        if len(numbers) > 0:
            raise _none_of_them([seen[k] for k in numbers], wanted.name)
        return ()
    if len(found) > 1 and wanted.is_sought_again:
        raise PartProblemError(
            "many_parts",
            f"{len(found)} objects on the table may be the {wanted.name} that was lost: "
            f"{where([seen[k] for k in found])}; take the others away",
        )
    if len(found) > 1 and wanted.serial:
        raise PartProblemError(
            "many_parts",
            f"{len(found)} parts {wanted.name} on the table: "
            f"{where([seen[k] for k in found])}; which of them has the serial number "
            f"{wanted.serial}, no picture shows: lay parts with serial numbers one at a time",
        )
    return found


def chosen(seen: Sequence[SightingFields], among: Sequence[int], counts: Sequence[int]) -> int:
    """Return the number of the object to take: known for sure, free of others, with many grasps.

    Parameters
    ----------
    seen : all objects on the table
    among : numbers of those that may be taken, at least one
    counts : of each object seen, by how many paths it could be taken from among the others

    Raises
    ------
    PartProblemError : each of them is too near to something
    """

    def worth(k: int) -> tuple[bool, bool, float, int]:
        one = seen[k]
        return not one.ambiguous_with, one.touching_count == 0, one.free_share, counts[k]

    free = [k for k in among if counts[k] > 0]
    if not free:
        raise PartProblemError(
            "many_parts",
            f"{len(seen)} objects on the table: {where(seen)}; no gripper gets at "
            f"{seen[among[0]].part} between them: move them apart",
        )
    return max(free, key=worth)


def where(seen: Sequence[SightingFields]) -> str:
    """Return what lies where, for a message."""
    return "; ".join(
        f"{one.part or 'unknown object'} at x {one.x_mm:.0f}, y {one.y_mm:.0f} mm"
        + (", touching another" if one.touching_count else "")
        + (", partly outside the backlit area" if one.is_cut else "")
        for one in seen
    )


def _may_be_taken(one: SightingFields, name: str) -> bool:
    return one.part == name and one.T_world_part is not None and not one.is_cut


def _without_neighbours(
    seen: Sequence[SightingFields], neighbours: Sequence[SightingFields]
) -> tuple[int, ...]:
    """Return the numbers of the objects that no neighbour of before accounts for, nearest first."""
    pairs = sorted(
        (float(np.hypot(one.x_mm - before.x_mm, one.y_mm - before.y_mm)), k, n)
        for k, one in enumerate(seen)
        for n, before in enumerate(neighbours)
        if before.part is None or one.part is None or before.part == one.part
    )
    accounted: dict[int, int] = {}
    for away_mm, k, n in pairs:
        if away_mm <= PUSHED_MM and k not in accounted and n not in accounted.values():
            accounted[k] = n
    return tuple(k for k in range(len(seen)) if k not in accounted)


def _none_of_them(seen: Sequence[SightingFields], name: str) -> PartProblemError:
    """Return why none of some objects is taken."""
    if len(seen) > 1:
        return PartProblemError(
            "many_parts",
            f"{len(seen)} objects on the table, and none is {name} that can be taken: "
            f"{where(seen)}; lay {name} there, or start with a recipe for one of them",
        )
    (one,) = seen
    at = f"at x {one.x_mm:.0f}, y {one.y_mm:.0f} mm"
    if one.part is None:
        return PartProblemError(
            "unknown_object",
            f"the object {at}: {one.reason}; take it away, or check the recipe's `part:`",
        )
    if one.is_cut:
        return PartProblemError(
            "part_cut_off",
            f"{one.part} {at} lies partly outside the backlit area: "
            f"{100 * one.free_share:.0f} % of its outline is seen; move it inwards and start again",
        )
    return PartProblemError(
        "wrong_part",
        f"{one.part} is {at}, the recipe is for {name}; put that there, or start with a recipe "
        f"for {one.part}",
    )
