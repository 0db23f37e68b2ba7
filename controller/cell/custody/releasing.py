"""Guided recovery: report what the grippers may hold, and open one of them for a person.

For a cell whose last controller ended with a part in a gripper. The arm does not move. A person
must hold the part before a jaw opens; the journal records their statement that they do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from controller.config import Cell
from drivers.kinds import GripperReading
from messages import key

from ..devices import Devices, resolve
from ..devices.clocks import FoundClock
from ..devices.interlocks import check_interlocks
from ..errors import CellError
from ..journal import JOURNAL_NAME, Journal, Once, rows
from .fold import (
    CellIdentity,
    Custody,
    GripperName,
    Held,
    fold_custody,
    recorded_grippers,
)
from .known_journals import (
    after_known,
    lost_rows,
    lost_words,
    note_journal,
    open_noted_journal,
    rows_of_all_journals,
    why_lost,
)
from .left_leases import LeftLease, read_left_leases
from .openings import Occupancy, Opening, read_openings
from .start_check import note_taken_out, openings_row

# Enough to take a part out, and too little for the jaws to meet anything beside it.
OPEN_BY_MM: Final = 20.0
INTENTS: Final = {
    GripperName.ARM: Once.OPEN_ARM_GRIPPER,
    GripperName.FIXED: Once.OPEN_FIXED_GRIPPER,
}


class ReleaseImpossibleError(CellError):
    """A gripper cannot be opened without another, unwanted motion; nothing has moved."""


@dataclass(frozen=True, slots=True)
class GripperStanding:
    """The known state of a cell's grippers.

    Attributes
    ----------
    known : from the journals of all runs
    openings : state read from the grippers themselves
    notice : fault found in the journal; empty if there was none
    leases : leases that the last run held when its controller died
    unknown : grippers that cannot be read, and of which no journal has recorded anything
    """

    known: tuple[Held, ...]
    openings: tuple[Opening, Opening]
    notice: str
    leases: tuple[LeftLease, ...] = ()
    unknown: frozenset[GripperName] = frozenset()


class ReleaseVisit:
    """One visit to a cell at rest, journaled like a run; usable as ``async with``.

    Parameters
    ----------
    cell : the cell; its devices must have addresses
    clock : the cell's clock, as it was found
    runs_dir : folder of all runs and of the journal
    opens : a gripper is to be opened, so that a new journal may begin where the noted one is lost
    """

    def __init__(
        self, cell: Cell, clock: FoundClock, runs_dir: Path, *, opens: bool = False
    ) -> None:
        self._cell = cell
        self._found_clock = clock
        self._runs_dir = runs_dir
        self._opens = opens
        self._journal: Journal | None = None

    async def __aenter__(self) -> "ReleaseVisit":
        """Open the journal, connect the grippers, halt all motion."""
        now = datetime.now(UTC)
        run = f"{now:%Y%m%d-%H%M%S}-{now.microsecond // 1000:03d}-recover"
        where = resolve(self._cell, {})
        self._began = after_known(self._who_and_what(where))
        path = self._runs_dir / JOURNAL_NAME
        self._notice = ""
        self._lost = why_lost(path, self._began)
        if self._opens or not self._lost:
            opened = open_noted_journal(path, run, self._began, may_begin_anew=self._opens)
            self._journal, self._notice = opened.journal, opened.notice
        self._clock = self._found_clock.open()
        self._devices = Devices.build(self._cell, where, self._clock)
        try:
            if self._journal is not None:
                await self._journal.write_secured(self._began)
                note_journal(self._journal, self._began)
            self._note(rows.Connected(await self._devices.connect_grippers()))
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close everything; opens no jaw."""
        await self._devices.aclose()
        self._clock.close()
        self._note(rows.RunEnded(end="stopped"))
        if self._journal is not None:
            self._journal.close()

    def _note(self, row: rows.Body) -> None:
        """Write a row to the journal; does nothing if the noted journal is lost."""
        if self._journal is not None:
            self._journal.write(row)

    @property
    def devices(self) -> Devices:
        """The arm, the fixed gripper and the I/O block, connected."""
        return self._devices

    @property
    def journal(self) -> Journal | None:
        """The cell's journal; None if the noted one is lost."""
        return self._journal

    @property
    def began(self) -> rows.RunBegan:
        """The first row of this visit."""
        return self._began

    def _who_and_what(self, where: Mapping[str, dict[str, Any]]) -> rows.RunBegan:
        return rows.RunBegan(
            recipe={"name": "recover"},
            cell=self._cell.model_dump(mode="json", by_alias=True),
            devices=where,
            emulated_devices=tuple(self._cell.emulated_devices),
            clock=None if self._found_clock.path is None else str(self._found_clock.path),
            count=0,
        )

    async def look(self) -> GripperStanding:
        """Return the parts that the grippers may hold; nothing moves."""
        here = CellIdentity.of(self._began)
        openings = await read_openings(self._devices)
        if self._journal is None:
            path = self._runs_dir / JOURNAL_NAME
            known = fold_custody(lost_rows(path, self._lost), here)
            return GripperStanding(known, openings, lost_words(path, self._lost))
        found = rows_of_all_journals(self._journal.path, self._began)
        known = fold_custody(found, here)
        unread = {one.gripper for one in openings if one.occupancy is Occupancy.UNREADABLE}
        unknown = frozenset(unread - recorded_grippers(found, here))
        self._note(openings_row(openings))
        leases = read_left_leases(self._journal.path, here)
        return GripperStanding(known, openings, self._notice, leases, unknown)

    async def open(self, gripper: GripperName, known: Sequence[Held]) -> Custody:
        """Open one gripper while a person holds the part; return the custody that follows.

        Parameters
        ----------
        gripper : gripper to open
        known : grippers that may hold it now

        Raises
        ------
        InterlockError : emergency stop or supply are not healthy
        ReleaseImpossibleError : the gripper must first be activated, which would close it
        DeviceError : it does not open
        """
        assert self._journal is not None, "opened without the journal that an opening needs"
        check_interlocks(self._devices.io, is_person_inside=True)
        if gripper is GripperName.FIXED:
            _require_ready(await self._devices.gripper.status())
        await self._journal.write_secured(
            rows.Intent(
                name=INTENTS[gripper], by="operator", detail=key("the part is held by hand")
            )
        )
        if gripper is GripperName.ARM:
            await self._devices.arm.enable_power()
            await self._devices.arm.drive_jaws(OPEN_BY_MM)
        else:
            await self._devices.gripper.open_to(self._devices.gripper.max_opening_mm)
        self._journal.write(rows.OnceDone(name=INTENTS[gripper]))
        left = {one.gripper for one in known} - {gripper}
        custody = Custody.REMOVED
        if GripperName.ARM in left:
            custody = Custody.IN_ARM
        elif left:
            custody = Custody.IN_FIXED
        await self._journal.write_secured(
            rows.CustodyChanged(
                name=custody.key,
                by="operator",
                detail=f"the {gripper.value} was opened",
            )
        )
        if custody is Custody.REMOVED:
            note_taken_out(self._journal, known)
        return custody


def _require_ready(status: GripperReading) -> None:
    if not status.is_activated or status.has_fault:
        raise ReleaseImpossibleError(
            key(
                "the fixed gripper is not active, and activating it would close its jaws first. "
                "Nothing has moved. Take the part out by the gripper's own release, then start "
                "with --part-removed"
            )
        )
