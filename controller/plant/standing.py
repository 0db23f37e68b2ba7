"""The state of a cell for a plant: by its control socket, else by lock and journal. Reads only."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Literal

from controller.cell.control import (
    ControlError,
    NoRunError,
    NotServedError,
    RunningCell,
    StandingReply,
    StatusReply,
    standing_of,
)
from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    journal_mark,
)
from controller.cell.lock import LOCK_NAME, read_holder

from .model import CellState, Packml, Question
from .tally import RunTally

# The first word of a state of ours, in PackML's own words.
PACKML: Final[Mapping[str, Packml]] = {
    "stopped": "Stopped", "idle": "Idle", "resetting": "Resetting", "execute": "Execute",
    "suspending": "Suspending", "suspended": "Suspended", "unsuspending": "Unsuspending",
    "holding": "Holding", "held": "Held", "stopping": "Stopping", "aborting": "Aborting",
    "aborted": "Aborted", "clearing": "Clearing", "completing": "Completing",
    "complete": "Complete", "free": "Idle", "left": "Aborted", "taken": "Stopped",
    "starting": "Starting", "unknown": "Stopped",
}  # fmt: skip


def packml_of(state: str) -> Packml:
    """Return PackML's word for a state of ours."""
    return PACKML.get(state.partition("_")[0], "Stopped")


@dataclass(slots=True)
class StateReader:
    """Reads the state of a cell; what the journal says of a run is read once for each change.

    Parameters
    ----------
    runs_dir : folder of all runs
    cell : name of the cell
    may_start : the cell file's permit
    """

    runs_dir: Path
    cell: str
    may_start: Literal["never", "asked", "yes"]
    _mark: object = None
    _tally: RunTally | None = None
    _standing: StandingReply | None = None
    _standing_mark: object = None

    def read(self) -> CellState:
        """Return the state now. Blocks for as long as the run takes to answer."""
        try:
            return self._with_run(RunningCell(self.runs_dir).status())
        except (NoRunError, NotServedError):
            return self._without_run()
        except (ControlError, OSError) as error:
            return self._made("unknown", message=str(error))

    def _with_run(self, found: StatusReply) -> CellState:
        question = found.question
        tally = self._counted(found.run)
        began = tally.began
        barred = found.question.text if found.question else found.message or found.barred
        return self._made(
            found.state,
            message=barred,
            run=found.run,
            recipe=found.recipe or (began and str(began.recipe.get("name", ""))) or None,
            order=(began and began.order_number) or None,
            part=tally.part,
            serial=found.serial or None,
            question=None
            if question is None
            else Question(number=question.number, code=question.code, text=question.text),
            alarms=found.alarms,
            done=found.done,
            counts=tally.counts,
            is_emulated=None if began is None else bool(began.emulated_devices),
        )

    def standing(self) -> StandingReply:
        """Return what is known without asking a run; read anew where lock or journal have changed.

        Raises
        ------
        JournalError : the journal cannot be read
        OSError : the folder cannot be read
        """
        holder = read_holder(self.runs_dir / LOCK_NAME)
        mark = (journal_mark(self.runs_dir / JOURNAL_NAME), holder)
        if self._standing is None or mark != self._standing_mark:
            self._standing, self._standing_mark = standing_of(self.runs_dir), mark
        return self._standing

    def _without_run(self) -> CellState:
        try:
            standing = self.standing()
        except (JournalError, OSError) as error:
            return self._made("unknown", message=str(error))
        is_run = standing.holder is not None and bool(standing.holder.control)
        state = "starting" if is_run else standing.state
        return self._made(
            state,
            message=standing.message,
            is_ready=state == "free" and self.may_start != "never",
        )

    def _made(self, state: str, **more: Any) -> CellState:  # noqa: ANN401 - of the model
        return CellState(
            cell=self.cell,
            at=datetime.now(UTC),
            state=state,
            packml=packml_of(state),
            may_start=self.may_start,
            **more,
        )

    def _counted(self, run: str) -> RunTally:
        """Return what the journal has of a run; what it had, where it cannot be read now."""
        journal = self.runs_dir / JOURNAL_NAME
        if self._tally is None or self._tally.run != run:
            self._tally, self._mark = RunTally(journal, run), None
        with suppress(JournalError, OSError, ValueError):  # the status is told without it
            mark = journal_mark(journal)
            if mark != self._mark:
                self._tally.look()
                self._mark = mark
        return self._tally
