"""The holder of the part: gripper, tray or table. Reported whenever the cell stops, never guessed.

Custody belongs to the cell, not to the run. `fold_custody` reads it from the rows of all runs, so
that a start knows of parts that an earlier run left in a gripper, however that run ended.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Final

from messages import key, say

from ..journal import Once, Row, RowKind, is_of, is_once, read_rows_of_kinds, rows


class Custody(StrEnum):
    """The place of the part."""

    NONE = key("no part known")
    ON_TABLE = key("on the table")
    IN_ARM = key("in the arm gripper")
    IN_BOTH = key("in both grippers")
    IN_FIXED = key("in the fixed gripper")
    PLACED = key("placed")
    REMOVED = key("taken out by the operator")
    LOST = key("lost")
    UNKNOWN = key("unknown")

    @property
    def key(self) -> str:
        """Its word in journals and reports, which stays when the constant is renamed."""
        return "in_fixture" if self is Custody.IN_FIXED else self.name.lower()

    @classmethod
    def of_key(cls, key: str) -> "Custody":
        """Return the custody for a journal's word; UNKNOWN if no version ever wrote that word."""
        return next((custody for custody in cls if custody.key == key.lower()), cls.UNKNOWN)


class GripperName(StrEnum):
    """The two grippers of a cell."""

    ARM = key("arm gripper")
    FIXED = key("fixed gripper")


BOTH: Final = frozenset(GripperName)
NEITHER: Final[frozenset[GripperName]] = frozenset()
# A lost part may still hang loosely in either gripper.
MAY_HOLD: Final[Mapping[Custody, frozenset[GripperName]]] = {
    Custody.NONE: NEITHER,
    Custody.ON_TABLE: NEITHER,
    Custody.IN_ARM: frozenset({GripperName.ARM}),
    Custody.IN_BOTH: BOTH,
    Custody.IN_FIXED: frozenset({GripperName.FIXED}),
    Custody.PLACED: NEITHER,
    Custody.REMOVED: NEITHER,
    Custody.LOST: BOTH,
    Custody.UNKNOWN: BOTH,
}
# Between its intent and the next custody row, an action that is never repeated blindly may have
# left the part in these grippers. An action that is not listed may have left it in either.
TOUCHED: Final[Mapping[str, frozenset[GripperName]]] = {
    Once.GRASP: frozenset({GripperName.ARM}),
    Once.SET_DOWN: frozenset({GripperName.ARM}),
    Once.SORT: frozenset({GripperName.ARM}),
    Once.OPEN_ARM_GRIPPER: frozenset({GripperName.ARM}),
    Once.OPEN_FIXED_GRIPPER: frozenset({GripperName.FIXED}),
}
# The kinds of rows that `fold_custody` reads, without events and without the rows that leave
# custody unchanged, which are most of a journal.
FOLDED_KINDS: Final[tuple[RowKind, ...]] = ("custody", "intent")
NOT_FOLDED: Final = (rows.PathBegun.row_name,)
FOLDED_EVENTS: Final = (
    rows.RunBegan.row_name,
    rows.JournalSetAside.row_name,
    rows.JournalNotReadable.row_name,
)
_UNTRUSTED: Final = key("the journal before this one cannot be trusted")


@dataclass(frozen=True, slots=True)
class CellIdentity:
    """The cell and the grippers that a run worked with.

    Attributes
    ----------
    name : name of the cell, as its file says
    grippers : address of each one; for an emulated one, its emulator's process, with which it ends
    emulated : names of those that the run's own emulator provides
    """

    name: str
    grippers: Mapping[GripperName, str]
    emulated: frozenset[GripperName]

    @classmethod
    def of(cls, began: rows.RunBegan) -> "CellIdentity":
        """Return the identity that a run's first row gives."""
        names = {"arm": GripperName.ARM, "gripper": GripperName.FIXED}
        emulator = began.emulator
        # An emulated cell with addresses given by hand outlives its runs, as a real cell does.
        listed = set(began.emulated_devices) if "pid" in emulator else set()
        emulated = frozenset(names[device] for device in listed if device in names)
        process = f"emulator {emulator.get('pid')} {emulator.get('started_wall_s')}"
        where = {}
        for device, gripper in names.items():
            settings = began.devices.get(device, {})
            address = f"{settings.get('address')} {settings.get('unit')}"
            where[gripper] = process if gripper in emulated else address
        return cls(str(began.cell.get("name")), where, emulated)

    @property
    def outlives_the_run(self) -> bool:
        """Whether a gripper stays when the run ends; those of the run's own emulator do not."""
        return set(self.grippers) != set(self.emulated)

    def shares(self, gripper: GripperName, other: "CellIdentity") -> bool:
        """Return whether a gripper is, or may be, the other cell's gripper as well.

        A real gripper counts as the same one if either the cell's name or its address is the same:
        a new cable changes the address, an edit of the cell file changes the name.
        """
        if (gripper in self.emulated) != (gripper in other.emulated):
            return False
        if self.grippers[gripper] == other.grippers[gripper]:
            return True
        return gripper not in self.emulated and self.name == other.name


@dataclass(frozen=True, slots=True)
class Held:
    """The journal's record of a gripper that may hold something.

    Attributes
    ----------
    since : time of that row, UTC
    detail : detail of that row, or the action that was cut off
    """

    gripper: GripperName
    custody: Custody
    run: str
    part: int | None
    since: str
    detail: str


def read_folded(path: Path) -> Iterator[Row]:
    """Yield the rows of a journal that `fold_custody` needs, in order.

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    yield from read_rows_of_kinds(path, FOLDED_KINDS, FOLDED_EVENTS, without=NOT_FOLDED)


def fold_custody(found: Iterable[Row], here: CellIdentity) -> tuple[Held, ...]:
    """Return the grippers of a cell that may hold a part, from the rows of all its runs.

    An action that is never repeated blindly (grasp, release, hand-off, sort) makes custody unknown
    from its intent until the next custody row, whether or not its outcome was written.

    Parameters
    ----------
    found : as `read_folded` yields them, of all runs, in order
    here : the cell whose grippers are in question
    """
    cells: dict[str, CellIdentity] = {}
    held: dict[GripperName, Held] = {}
    for row in found:
        if is_of(row, rows.RunBegan):
            with suppress(ValueError):  # an unreadable first row counts as a missing one
                cells[row.run] = CellIdentity.of(rows.RunBegan.model_validate(row.body))
            continue
        for gripper in GripperName:
            is_aside = is_of(row, rows.JournalSetAside)
            if is_aside or is_of(row, rows.JournalNotReadable):
                if gripper not in here.emulated:
                    why = _UNTRUSTED if is_aside else str(row.body["why"])
                    held[gripper] = _held(gripper, Custody.UNKNOWN, row, why)
                continue
            cell = cells.get(row.run)
            # A run without its first row may have been in any cell.
            if cell is not None and not here.shares(gripper, cell):
                continue
            if row.kind == "custody":
                custody = Custody.of_key(row.name)
                held.pop(gripper, None)
                if gripper in MAY_HOLD[custody]:
                    detail = str(row.body.get("detail", ""))
                    held[gripper] = _held(gripper, custody, row, detail)
            elif is_once(row) and gripper in TOUCHED.get(row.name, BOTH):
                why = say("cut off while it did: {name}", name=row.name.replace("_", " "))
                held[gripper] = _held(gripper, Custody.UNKNOWN, row, why)
    return tuple(held[gripper] for gripper in GripperName if gripper in held)


def recorded_grippers(found: Iterable[Row], here: CellIdentity) -> frozenset[GripperName]:
    """Return the grippers of a cell whose content some run has recorded.

    The others are unknown to the journals, which does not mean that they are empty.

    Parameters
    ----------
    found : as `read_folded` yields them, of all runs, in order
    here : the cell whose grippers are in question
    """
    cells: dict[str, CellIdentity] = {}
    recorded: set[GripperName] = set()
    for row in found:
        if is_of(row, rows.RunBegan):
            with suppress(ValueError):
                cells[row.run] = CellIdentity.of(rows.RunBegan.model_validate(row.body))
        elif row.kind == "custody" and (cell := cells.get(row.run)) is not None:
            recorded |= {gripper for gripper in GripperName if here.shares(gripper, cell)}
    return frozenset(recorded)


def _held(gripper: GripperName, custody: Custody, row: Row, detail: str) -> Held:
    return Held(gripper, custody, row.run, row.part, row.t_utc, detail)


def custody_of(known: Sequence[Held]) -> Custody:
    """Return the part's custody, by what the journals say of the grippers; NONE for nothing."""
    return known[0].custody if known else Custody.NONE


def known_words(one: Held) -> str:
    """Return in words the journal's record of a gripper: its part, of which run, since when."""
    part = say("part {part} of ", part=one.part) if one.part else ""
    since = f"{datetime.fromisoformat(one.since):%Y-%m-%d %H:%M:%S}"
    detail = say(" ({detail})", detail=one.detail) if one.detail else ""
    what = key("its position is unknown") if one.custody is Custody.UNKNOWN else one.custody.value
    return say(
        "{part}run {run}, {what}{detail} since {since} UTC",
        part=part,
        run=one.run,
        what=what,
        detail=detail,
        since=since,
    )


def where_it_is(custody: Custody, detail: str = "") -> str:
    """Return a sentence for the operator: the part's place and what to do with it."""
    more = say(" ({detail})", detail=detail) if detail else ""
    match custody:
        case Custody.NONE | Custody.ON_TABLE:
            return say("The part is on the table{more}; both grippers are empty.", more=more)
        case Custody.IN_ARM:
            return say(
                "The part is in the arm gripper{more}, which keeps holding it. "
                "Support the part before you cut the power or open the jaws.",
                more=more,
            )
        case Custody.IN_BOTH:
            return say(
                "The part is in both grippers{more}, which keep holding it. Open "
                "one of them only while the other holds.",
                more=more,
            )
        case Custody.IN_FIXED:
            return say("The part is in the fixed gripper{more}, which keeps holding it.", more=more)
        case Custody.PLACED:
            return say("The part is in its tray{more}.", more=more)
        case Custody.REMOVED:
            return say("The part was taken out by the operator{more}.", more=more)
        case Custody.LOST:
            return say(
                "The part was lost{more}: look for it below the arm's last path, by hand.",
                more=more,
            )
        case Custody.UNKNOWN:
            return say(
                "The position of the part is unknown{more}: look for it before anything moves.",
                more=more,
            )
