"""No jaw moves on an assumption: both grippers must be known to be empty before anything moves.

The journals of all runs and both openings are checked. If one of them names a gripper, nothing
moves until the operator has stated that the part is out. A gripper that reports an object outweighs
the operator's statement.
"""

from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import Final, NoReturn

from messages import joined, key, say

from ..errors import CellError
from ..journal import Journal, rows
from .fold import Custody, GripperName, Held, custody_of, known_words
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
            GripperName.ARM, Occupancy.HOLDS, key("its jaws, pressed once more, stay open")
        )
        await refuse([stopped])
    if known or uncertain:
        said = key("stated with --part-removed")
        before = joined("; ", (known_words(one) for one in known))
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
        {
            one.gripper.value: say(
                "{value}: {reason}", value=one.occupancy.value, reason=one.reason
            )
            for one in openings
        }
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


# Sentences are whole for each, since other languages decide on more than the verb.
HOLDS: Final[Mapping[frozenset[GripperName], str]] = {
    frozenset({GripperName.ARM}): key("The arm gripper holds a part: {reasons}."),
    frozenset({GripperName.FIXED}): key("The fixed gripper holds a part: {reasons}."),
    frozenset(GripperName): key("The arm gripper and the fixed gripper hold a part: {reasons}."),
}
MAY_HOLD: Final[Mapping[frozenset[GripperName], str]] = {
    frozenset({GripperName.ARM}): key("The arm gripper may hold a part: {reasons}."),
    frozenset({GripperName.FIXED}): key("The fixed gripper may hold a part: {reasons}."),
    frozenset(GripperName): key(
        "The arm gripper and the fixed gripper may hold a part: {reasons}."
    ),
}
REPORTS: Final[Mapping[GripperName, str]] = {
    GripperName.ARM: key("the arm gripper reports that {reason}"),
    GripperName.FIXED: key("the fixed gripper reports that {reason}"),
}
OPENS: Final[Mapping[GripperName, str]] = {
    GripperName.ARM: "`cellctl recover --cell CELL --open arm`",
    GripperName.FIXED: "`cellctl recover --cell CELL --open fixed`",
}


def _refusal(
    known: Sequence[Held], openings: Sequence[Opening], *, is_part_removed: bool, why: str
) -> str:
    """Return the refusal: the holder and since when, that nothing has moved, and the ways on."""
    named = {one.gripper for one in known} | {one.gripper for one in openings}
    is_sure = any(one.occupancy is Occupancy.HOLDS for one in openings)
    reasons = [
        *dict.fromkeys(known_words(one) for one in known),
        *(say(REPORTS[one.gripper], reason=one.reason) for one in openings),
    ]
    opens = joined(" or ", (OPENS[name] for name in GripperName if name in named))
    again = "" if is_part_removed else key(" with --part-removed")
    holds = (HOLDS if is_sure else MAY_HOLD)[frozenset(named)]
    held = say(holds, reasons=joined("; ", reasons))
    on = key(
        "To go on with the part, start with --auto-recover, or use `cellctl recover --accept`. "
    )
    if why:
        on = say("The cell does not go on by itself: {why}. ", why=why)
    elif not known or is_part_removed:
        on = ""
    return say(
        "{held} Nothing has moved. {on}To take the part out: {opens} opens the gripper while you "
        "hold it; then start again{again}.",
        held=held,
        on=on,
        opens=opens,
        again=again,
    )
