"""Folds a run's journal rows into a `RunRecord`, whether or not the run came to an end."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Final, TypeVar, cast

from pydantic import ValidationError

from controller.cell.custody import Custody, where_it_is
from controller.cell.journal import CELL_TIME, Body, Row, is_of, read_row, rows
from messages import joined, key, say

from ._parts import PartFold
from ._stored import copies_in, stored_files
from .log_words import row_words
from .model import (
    DeviceReport,
    DryStepReport,
    End,
    LogEntry,
    PartReport,
    ResultsError,
    RunOutcome,
    RunRecord,
    StageReport,
)

SomeBody = TypeVar("SomeBody", bound=Body)

ENDS: Final = ("complete", "held", "stopped", "aborted", "refused")
EARLY: Final = ("stopped", "aborted")  # ends after which the next start finds the table unchanged


def fold(run_id: str, folder: Path, found: Sequence[Row], broken: int | None) -> RunRecord:
    """Return the record of a run, folded from its rows.

    Parameters
    ----------
    run_id : id of the run
    folder : folder of the run
    found : its rows in order, at least one
    broken : number of the journal's first row whose hash does not fit

    Raises
    ------
    ResultsError : a row is not what this version of cellctl writes
    """
    log = tuple(entry_of(row, found[0].t_mono_s) for row in _of_the_run(found))
    # what was added later, perhaps after a restart of the machine, has other times
    later = (rows.PartReviewed, rows.PartFollowed)
    own = tuple(one for one in log if not isinstance(one.row, later)) or log
    began = _last(log, rows.RunBegan) or rows.RunBegan()
    ended = _last(log, rows.RunEnded)
    stood = _last(log, rows.CalibrationsStood)
    at_rest, broke_off = _last(log, rows.AtRest), _last(log, rows.RunBrokeOff)
    is_cut_off = at_rest is None and broke_off is None
    is_ended_early = broke_off is not None or (at_rest is not None and at_rest.state in EARLY)
    parts = _parts(log, is_cut_off=is_cut_off, is_ended_early=is_ended_early)
    # a broken row after this run's last one does not affect it
    is_touched = broken is not None and broken <= found[-1].seq
    return RunRecord(
        run_id=run_id,
        folder=folder,
        recipe=began.recipe,
        cell=began.cell,
        devices=_devices(began, _last(log, rows.Connected)),
        emulator=began.emulator,
        software=began.software,
        speed=began.speed,
        speed_reached=None if ended is None else ended.speed.reached,
        ordered=len(parts) if began.count is None else began.count,
        start=log[0].at,
        end=own[-1].at,
        wall_s=own[-1].t_s,
        outcome=_outcome(own, parts, at_rest, broke_off),
        parts=parts,
        stages=_stages(own),
        log=log,
        first_broken_row=broken if is_touched else None,
        files=began.files,
        operator=began.operator,
        lot=began.lot,
        order_number=began.order_number,
        serials=began.serials,
        part_temperature_c=began.part_temperature_c,
        calibration=None if stood is None else stood.sentences,
        dry=_dry(log) if began.is_dry else None,
        ordered_recipes=began.ordered,
        stored={file: digest for file, (digest, _) in stored_files(found).items()},
        copies=copies_in(found),
    )


def _dry(log: Sequence[LogEntry]) -> tuple[DryStepReport, ...]:
    return tuple(
        DryStepReport(
            label=row.label,
            pose_index=row.pose_index,
            motions=row.waypoints,
            lifted_mm=row.lifted_mm,
            left_out=row.left_out,
            seconds=row.seconds,
        )
        for row in (entry.row for entry in log)
        if isinstance(row, rows.DryStepDone)
    )


def entry_of(row: Row, t0_s: float) -> LogEntry:
    """Return a row with its model, if this version knows and can read it.

    Parameters
    ----------
    row : row of the journal
    t0_s : instant of the run's first row [wall s]
    """
    said, flaw = None, ""
    try:
        said = read_row(row.kind, row.name, row.body)
    except ValueError as error:
        flaw = _first_line(error)
    return LogEntry(
        seq=row.seq,
        at=datetime.fromisoformat(row.t_utc),
        t_s=row.t_mono_s - t0_s,
        part=row.part,
        kind=row.kind,
        name=row.name,
        body={key: value for key, value in row.body.items() if key != CELL_TIME},
        cell_s=row.cell_s,
        row=said,
        flaw=flaw,
    )


def _first_line(error: ValueError) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(str(key) for key in first['loc'])}: {first['msg']}"
    return str(error)


def _last(log: Sequence[LogEntry], model: type[SomeBody]) -> SomeBody | None:
    """Return the last row of a model.

    Raises
    ------
    ResultsError : it cannot be read
    """
    for entry in reversed(log):
        if isinstance(entry.row, model):
            return entry.row
        if entry.flaw and (entry.kind, entry.name) == (model.kind, model.row_name):
            raise _unreadable(entry)
    return None


def _unreadable(entry: LogEntry) -> ResultsError:
    return ResultsError(
        f"journal row {entry.seq} ({entry.kind} {entry.name}) is not what this version of "
        f"cellctl writes: {entry.flaw}; report it with the version that wrote it"
    )


def _parts(
    log: Sequence[LogEntry], *, is_cut_off: bool, is_ended_early: bool
) -> tuple[PartReport, ...]:
    folds: dict[int, PartFold] = {}
    for entry in log:
        if not entry.part:
            continue  # rows from before the first part have number 0
        if entry.flaw:
            raise _unreadable(entry)
        folds.setdefault(entry.part, PartFold(entry.part)).take(entry.row, entry.at)
    return tuple(
        folds[number].report(is_cut_off=is_cut_off, is_ended_early=is_ended_early)
        for number in sorted(folds)
    )


def _devices(began: rows.RunBegan, connected: rows.Connected | None) -> tuple[DeviceReport, ...]:
    said = {} if connected is None else connected.root
    return tuple(
        DeviceReport(
            name=name,
            address=str(settings.get("address", "")),
            is_emulated=bool(settings.get("emulated", name in began.emulated_devices)),
            identity=said.get(name, ""),
        )
        for name, settings in began.devices.items()
    )


def _outcome(
    log: Sequence[LogEntry],
    parts: Sequence[PartReport],
    at_rest: rows.AtRest | None,
    broke_off: rows.RunBrokeOff | None,
) -> RunOutcome:
    last = parts[-1] if parts else None
    custody = last.custody if last else Custody.NONE
    where = _where(last)
    # a run may come to rest and still break off while it ends: then the later row counts
    if broke_off is not None:
        return RunOutcome("broke_off", broke_off.error, "broke_off", custody, where)
    if at_rest is not None:
        if at_rest.state not in ENDS:
            raise ResultsError(
                f"the journal has the run end as {at_rest.state!r}, which is not a state"
            )
        return RunOutcome(
            cast(End, at_rest.state),
            at_rest.message,
            at_rest.code,
            next((c for c in Custody if c.key.upper() == at_rest.custody), custody),
            at_rest.where or where,
        )
    then = f"part {last.number} then was {_held(last)}" if last else "no part was at hand"
    message = (
        f"the run has no end in the journal: it was cut off after “{row_words(log[-1])}” at "
        f"{log[-1].at:%H:%M:%S} UTC (unless it is still running); {then}"
    )
    return RunOutcome("cut_off", message, "cut_off", custody, where)


def _held(part: PartReport) -> str:
    held = joined("", (part.custody.value,))
    if part.custody_detail:
        held += say(" ({detail})", detail=part.custody_detail)
    return held + key(", or no longer") if part.unconfirmed else held


def _where(part: PartReport | None) -> str:
    if part is None:
        return where_it_is(Custody.NONE)
    if part.unconfirmed:
        return where_it_is(Custody.UNKNOWN, say("last known: {value}", value=part.custody.value))
    return where_it_is(part.custody, part.custody_detail)


def _of_the_run(found: Sequence[Row]) -> Sequence[Row]:
    """Return the rows up to the run's end; reports written later are noted after it."""
    last = next((i for i, row in enumerate(found) if is_of(row, rows.RunEnded)), len(found) - 1)
    later = (rows.FilesStored, rows.PicturesCopied, rows.PicturesDropped)
    rest = (row for row in found[last + 1 :] if not any(is_of(row, body) for body in later))
    return [*found[: last + 1], *rest]


def _stages(log: Sequence[LogEntry]) -> tuple[StageReport, ...]:
    """Return the time that the cell spent in each state, in the order of first entry."""
    spent: dict[str, list[float]] = {}
    state, since = "", 0.0
    for entry in log:
        if not isinstance(entry.row, rows.CellEvent) or entry.row.answer != "handled":
            continue
        if state:
            spent.setdefault(state, []).append(entry.t_s - since)
        state, since = entry.row.target, entry.t_s
    if state not in {"", *ENDS}:
        spent.setdefault(state, []).append(log[-1].t_s - since)
    return tuple(StageReport(name, len(times), sum(times)) for name, times in spent.items())
