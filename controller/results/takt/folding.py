"""Sums of the arm's time by use: for each part, and before and after the parts of a run."""

import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import groupby
from pathlib import Path
from typing import Final

from controller.cell.journal import JournalError, read_rows_of_kinds, records_elsewhere, rows
from controller.cell.machine import Event
from messages import say

from ..run import LogEntry, ResultsError, RunRecord, entry_of, whole_journal
from ._spans import Span, instants, spans
from .uses import BUSY, TimeUse

KINDS: Final = ("event", "intent", "outcome", "observation", "decision")
# Rows that the fold skips: long ones, and those that others write about a run, perhaps in the
# middle of the rows of a later one.
WITHOUT: Final = (
    rows.PartMeasured.row_name, rows.PartFindings.row_name, rows.PartJudged.row_name,
    rows.ViewJudged.row_name, rows.ViewsPosed.row_name, *(body.row_name for body in rows.ADDED),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class PartTakt:
    """The use of one part's time [cell s].

    Attributes
    ----------
    number : number of the part in its run; 0 for what belongs to none: before the first, after the
        last
    recipe : recipe of its inspection
    forecast_s : forecast of its first plan; None without one
    seconds : by use; they add up to `total_s`
    execute_s, busy_s : of Execute, and of that what the arm did by its plan
    late_wall_s : for how long the controller itself was late [wall s]; within the seconds above
    is_done : True if it is in its tray
    is_planned_ahead : its plan was made while the arm still had the part before it
    is_counted : this run has its record (ADR 37)
    """

    number: int
    recipe: str = ""
    forecast_s: float | None = None
    seconds: Mapping[TimeUse, float] = field(default_factory=dict)
    execute_s: float = 0.0
    busy_s: float = 0.0
    late_wall_s: float = 0.0
    is_done: bool = False
    is_planned_ahead: bool = False
    is_counted: bool = True

    @property
    def total_s(self) -> float:
        """Total time of the part."""
        return sum(self.seconds.values())


@dataclass(frozen=True, slots=True)
class RunTakt:
    """The use of a run's time.

    Attributes
    ----------
    parts : in order; of a run that was cut off the last one may not be done
    around : time that belongs to no part: connecting, homing, coming to rest
    has_cell_clock : its rows have instants of the cell's own clock; otherwise seconds are the
        wall's, which of an emulated cell say little
    """

    run_id: str
    recipe: str
    lot: str
    order_number: str
    operator: str
    start: datetime
    parts: tuple[PartTakt, ...]
    around: PartTakt
    has_cell_clock: bool


def takt_of(record: RunRecord) -> RunTakt:
    """Return a run's time, split by use.

    Parameters
    ----------
    record : record of the run
    """
    elsewhere = {
        (record.run_id, part.number)
        for part in record.parts
        if not part.is_counted and (part.followed is not None or part.resumed is not None)
    }
    return _fold(record.run_id, record.log, elsewhere)


def takts_of(runs_dir: Path) -> Iterator[RunTakt]:
    """Yield the time by use for all runs in a folder, oldest first.

    Parameters
    ----------
    runs_dir : folder with the journal

    Raises
    ------
    ResultsError : no journal, one that cannot be read, or one that was changed
    """
    path = whole_journal(runs_dir)
    try:
        elsewhere = records_elsewhere(path)
        found = read_rows_of_kinds(path, KINDS, (), WITHOUT)
        # two runs may share a journal, but never write to it at once: a cell has one controller
        for run_id, rows_of_run in groupby(found, key=lambda row: row.run):
            first, *rest = rows_of_run
            log = [entry_of(row, first.t_mono_s) for row in (first, *rest)]
            if any(isinstance(entry.row, rows.RunBegan) for entry in log):
                yield _fold(run_id, log, elsewhere)
    except (JournalError, sqlite3.Error, ValueError) as error:
        raise ResultsError(say("journal {path}: {error}", path=path, error=error)) from error


def _fold(run_id: str, log: Sequence[LogEntry], elsewhere: Set[tuple[str, int | None]]) -> RunTakt:
    log = _until_its_end([entry for entry in log if not isinstance(entry.row, rows.ADDED)])
    at_s, has_cell_clock = instants(log)
    began = next((e.row for e in log if isinstance(e.row, rows.RunBegan)), None) or rows.RunBegan()
    recipe = str(began.recipe.get("name", "unknown"))
    pieces = list(_pieces(log))
    found = list(spans(log, at_s))
    parts = tuple(
        replace(
            _part(number, recipe, log[begin:end], found[begin:end]),
            is_counted=(run_id, number) not in elsewhere,
        )
        for number, begin, end in pieces
    )
    inside = {k for _, begin, end in pieces for k in range(begin, end)}
    around = _part(0, recipe, (), [span for k, span in enumerate(found) if k not in inside])
    return RunTakt(
        run_id=run_id,
        recipe=recipe,
        lot=began.lot,
        order_number=began.order_number,
        operator=began.operator,
        start=log[0].at,
        parts=parts,
        around=around,
        has_cell_clock=has_cell_clock,
    )


def _until_its_end(log: Sequence[LogEntry]) -> Sequence[LogEntry]:
    """Return the rows up to the run's end; reports written later are noted after it."""
    ends = (i for i, entry in enumerate(log) if isinstance(entry.row, rows.RunEnded | rows.AtRest))
    last = next(ends, len(log) - 1)
    return log[: last + 1]


def _pieces(log: Sequence[LogEntry]) -> Iterator[tuple[int, int, int]]:
    """Yield number, first and last row of each part: from when the one before it was done.

    The row that ends a part is the event that follows on its being counted.
    """
    begin: int | None = None
    number = 0
    starts = (Event.START.value, Event.RECOVER.value)
    ends = (Event.PART_DONE.value, Event.BATCH_DONE.value)
    for k, entry in enumerate(log):
        number = max(number, entry.part or 0)
        if not isinstance(entry.row, rows.CellEvent) or entry.row.answer != "handled":
            continue
        if entry.name in starts and begin is None:
            begin = k
        elif entry.name in ends and begin is not None:
            yield number, begin, k
            begin = None if entry.name == Event.BATCH_DONE.value else k
    if begin is not None and begin < len(log) - 1:
        yield number, begin, len(log) - 1


def _part(number: int, recipe: str, log: Sequence[LogEntry], found: Iterable[Span]) -> PartTakt:
    seconds = dict.fromkeys(TimeUse, 0.0)
    execute_s = busy_s = 0.0
    for span in found:
        length_s = span.end_s - span.start_s
        seconds[span.use] += length_s
        execute_s += length_s if span.is_execute else 0.0
        busy_s += length_s if span.is_execute and span.use in BUSY else 0.0
    plans = [entry.row for entry in log if isinstance(entry.row, rows.PlanMade)]
    names = [entry.row.name for entry in log if isinstance(entry.row, rows.PartIdentified)]
    return PartTakt(
        number=number,
        recipe=names[-1] if names else recipe,
        forecast_s=plans[0].forecast_s if plans else None,
        seconds=seconds,
        execute_s=execute_s,
        busy_s=busy_s,
        late_wall_s=sum(e.row.missed_s for e in log if isinstance(e.row, rows.LoopLate)),
        is_planned_ahead=any(plan.is_ahead for plan in plans),
        is_done=any(isinstance(entry.row, rows.PartDone) for entry in log),
    )
