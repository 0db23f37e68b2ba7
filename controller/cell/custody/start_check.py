"""No jaw moves on an assumption: both grippers must be known to be empty before anything moves.

The journals of all runs and both openings are checked. If one of them names a gripper, nothing
moves until the operator has stated that the part is out. A gripper that reports an object outweighs
the operator's statement.
"""

from collections.abc import Awaitable, Callable, Iterable, Sequence
from datetime import datetime
from typing import NoReturn

from ..errors import CellError
from ..journal import Journal, rows
from .fold import Custody, GripperName, Held, custody_of
from .openings import Occupancy, Opening

Press = Callable[[], Awaitable[bool]]


class PartMayBeHeldError(CellError):
    """A gripper holds a part, or may hold one: nothing has moved.

    Attributes
    ----------
    custody : custody of the part, as far as it is known
    """

    def __init__(self, message: str, custody: Custody) -> None:
        super().__init__(message)
        self.custody = custody


async def require_empty_grippers(
    known: Sequence[Held],
    openings: Sequence[Opening],
    journal: Journal,
    press: Press,
    *,
    is_part_removed: bool,
    why: str = "",
) -> None:
    """Check that both grippers are known to be empty, and journal the evidence for it.

    Parameters
    ----------
    known : grippers that may hold a part by the journals of all runs
    openings : readings of the grippers themselves
    journal : records the openings, and the operator's statement or the refusal
    press : closes the arm gripper a little further and returns whether something is in it
    is_part_removed : the operator states that no gripper holds anything
    why : the cell does not go on with the part by itself; empty if it was not to

    Raises
    ------
    PartMayBeHeldError : a gripper holds something, or may hold something
    """

    async def refuse(against: Sequence[Opening]) -> NoReturn:
        message = _refusal(known, against, is_part_removed=is_part_removed, why=why)
        await journal.write_secured(
            rows.StartRefused(message=message, part_removed=is_part_removed)
        )
        sure = [one for one in against if one.occupancy is Occupancy.HOLDS]
        raise PartMayBeHeldError(message, _custody_of(known, sure))

    journal.write(openings_row(openings))
    holding = [one for one in openings if one.occupancy is Occupancy.HOLDS]
    uncertain = [one for one in openings if one.occupancy is Occupancy.MAY_HOLD]
    if holding or ((known or uncertain) and not is_part_removed):
        await refuse(holding or uncertain)
    if any(one.gripper is GripperName.ARM for one in uncertain) and await press():
        stopped = Opening(
            GripperName.ARM, Occupancy.HOLDS, "its jaws, pressed once more, stay open"
        )
        await refuse([stopped])
    if known or uncertain:
        said = "stated with --part-removed"
        before = "; ".join(known_words(one) for one in known)
        await journal.write_secured(
            rows.CustodyChanged(name=Custody.REMOVED.key, by="operator", detail=said, before=before)
        )
        note_taken_out(journal, known)


def note_taken_out(journal: Journal, known: Iterable[Held]) -> None:
    """Add to the runs that ended with parts in grippers that these were taken out by a person.

    Parameters
    ----------
    journal : journal of the run that learns it
    known : state of the grippers as recorded
    """
    for run, part in {(one.run, one.part) for one in known if one.part}:
        gone = rows.PartFollowed(run=journal.run, custody=Custody.REMOVED.key)
        journal.write_about(run, gone, part)


def openings_row(openings: Sequence[Opening]) -> rows.Openings:
    """Return the openings as the row that the journal keeps."""
    return rows.Openings(
        {one.gripper.value: f"{one.occupancy.value}: {one.reason}" for one in openings}
    )


def _custody_of(known: Sequence[Held], holding: Sequence[Opening]) -> Custody:
    if known:
        return custody_of(known)
    grippers = {one.gripper for one in holding}
    if not grippers:
        return Custody.UNKNOWN
    if len(grippers) == 2:
        return Custody.IN_BOTH
    return Custody.IN_ARM if GripperName.ARM in grippers else Custody.IN_FIXED


def _refusal(
    known: Sequence[Held], openings: Sequence[Opening], *, is_part_removed: bool, why: str
) -> str:
    """Return the refusal: the holder and since when, that nothing has moved, and the ways on."""
    named = {one.gripper for one in known} | {one.gripper for one in openings}
    holders = " and ".join(f"the {name.value}" for name in GripperName if name in named)
    is_sure = any(one.occupancy is Occupancy.HOLDS for one in openings)
    verb = ("hold" if len(named) > 1 else "holds") if is_sure else "may hold"
    reasons = [
        *dict.fromkeys(known_words(one) for one in known),
        *(f"the {one.gripper.value} reports that {one.reason}" for one in openings),
    ]
    opens = " or ".join(
        f"`cellctl recover --cell CELL --open {'arm' if name is GripperName.ARM else 'fixed'}`"
        for name in GripperName
        if name in named
    )
    again = "" if is_part_removed else " with --part-removed"
    first = f"{holders} {verb} a part: {'; '.join(reasons)}."
    on = "To go on with the part, start with --auto-recover, or use `cellctl recover --accept`. "
    if why:
        on = f"The cell does not go on by itself: {why}. "
    elif not known or is_part_removed:
        on = ""
    return (
        f"{first[0].upper()}{first[1:]} Nothing has moved. {on}To take the part out: {opens} opens "
        f"the gripper while you hold it; then start again{again}."
    )


def known_words(one: Held) -> str:
    """Return in words the journal's record of a gripper: its part, of which run, since when."""
    part = f"part {one.part} of " if one.part else ""
    since = datetime.fromisoformat(one.since)
    detail = f" ({one.detail})" if one.detail else ""
    what = "its position is unknown" if one.custody is Custody.UNKNOWN else one.custody.value
    return f"{part}run {one.run}, {what}{detail} since {since:%Y-%m-%d %H:%M:%S} UTC"
