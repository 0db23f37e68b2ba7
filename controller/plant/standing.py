"""The state of a cell for a plant: by its control socket, else by lock and journal. Reads only."""

from collections.abc import Mapping
from dataclasses import dataclass, field
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
from controller.cell.devices.lock import LOCK_NAME, read_holder
from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    journal_mark,
    read_rows_after,
    rows,
)

from .model import CellState, Disposition, Packml, Question

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
    _of_run: dict[str, Any] = field(default_factory=dict)
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
        of_run = self._journaled(found.run)
        barred = found.question.text if found.question else found.message or found.barred
        return self._made(
            found.state,
            message=barred,
            run=found.run,
            recipe=found.recipe or of_run.get("recipe"),
            order=of_run.get("order"),
            part=of_run.get("part", 0),
            serial=found.serial or None,
            question=None
            if question is None
            else Question(number=question.number, code=question.code, text=question.text),
            alarms=found.alarms,
            done=found.done,
            counts=of_run.get("counts", {}),
            is_emulated=of_run.get("is_emulated"),
        )

    def _without_run(self) -> CellState:
        try:
            mark = journal_mark(self.runs_dir / JOURNAL_NAME)
            is_held = read_holder(self.runs_dir / LOCK_NAME) is not None
            known = (mark, is_held)
            if self._standing is None or is_held or known != self._standing_mark:
                self._standing, self._standing_mark = standing_of(self.runs_dir), known
        except (JournalError, OSError) as error:
            return self._made("unknown", message=str(error))
        standing = self._standing
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

    def _journaled(self, run: str) -> Mapping[str, Any]:
        """Return what the journal has of a run."""
        journal = self.runs_dir / JOURNAL_NAME
        try:
            mark = (run, *journal_mark(journal))
            if mark == self._mark:
                return self._of_run
            found: dict[str, Any] = {} if self._of_run.get("run") != run else {**self._of_run}
            counts: dict[Disposition, int] = dict(found.get("counts", {}))
            for row in read_rows_after(journal, found.get("seq", 0), run):
                found["seq"] = row.seq
                if row.part:
                    found["part"] = row.part
                if row.name == rows.RunBegan.row_name:
                    began = rows.RunBegan.model_validate(row.body)
                    found["order"] = began.order_number or None
                    found["recipe"] = str(began.recipe.get("name", "")) or None
                    found["is_emulated"] = bool(began.emulated_devices)
                elif row.name == rows.PartDone.row_name:
                    tray = row.body.get("tray")
                    for one in ("accept", "reject", "quarantine"):
                        if tray == one:
                            counts[one] = counts.get(one, 0) + 1
        except (JournalError, OSError, ValueError):
            return {}  # the status is told without it
        self._of_run = {**found, "run": run, "counts": counts}
        self._mark = mark
        return self._of_run
