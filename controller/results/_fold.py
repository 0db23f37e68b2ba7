"""Folds a run's journal rows into a `RunRecord`; also a run that nobody ended."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final, cast

from controller.cell.custody import Custody, where_it_is
from controller.cell.journal import Row

from ._model import (
    DeviceReport,
    End,
    LogEntry,
    Outcome,
    PartReport,
    ResultsError,
    RunRecord,
    StageReport,
)
from ._parts import PartFold
from ._words import say_row

ENDS: Final = ("complete", "held", "stopped", "aborted", "refused")


def fold(run_id: str, folder: Path, rows: Sequence[Row], broken: int | None) -> RunRecord:
    """Return a run as its rows tell it.

    Parameters
    ----------
    rows : of this run, in order, at least one
    broken : number of the journal's first row whose hash does not fit

    Raises
    ------
    ResultsError : a row is not what this version of cellctl writes
    """
    log = tuple(_entry(row, rows[0].t_mono_s) for row in rows)
    began = _body(log, "run_began")
    at_rest, broke_off = _body(log, "at_rest"), _body(log, "run_broke_off")
    is_cut_off = not at_rest and not broke_off
    parts = _parts(log, is_cut_off=is_cut_off)
    # a row after this run's last one says nothing against it
    is_touched = broken is not None and broken <= rows[-1].seq
    return RunRecord(
        run_id=run_id,
        folder=folder,
        recipe=began.get("recipe", {}),
        cell=began.get("cell", {}),
        devices=_devices(began, _body(log, "connected")),
        emulator=began.get("emulator", {}),
        software={str(k): str(v) for k, v in began.get("software", {}).items()},
        speed=float(began.get("speed", 1.0)),
        speed_reached=_body(log, "run_ended").get("speed", {}).get("reached"),
        ordered=int(began.get("count", len(parts))),
        start=log[0].at,
        end=log[-1].at,
        wall_s=log[-1].t_s,
        outcome=_outcome(log, parts, at_rest, broke_off),
        parts=parts,
        stages=_stages(log),
        log=log,
        first_broken_row=broken if is_touched else None,
    )


def _entry(row: Row, t0_s: float) -> LogEntry:
    return LogEntry(
        seq=row.seq,
        at=datetime.fromisoformat(row.t_utc),
        t_s=row.t_mono_s - t0_s,
        part=row.part,
        kind=row.kind,
        name=row.name,
        body=row.body,
    )


def _body(log: Sequence[LogEntry], name: str) -> Mapping[str, Any]:
    """Return the body of the last event of that name, empty if there was none."""
    found = [e.body for e in log if e.kind == "event" and e.name == name]
    return found[-1] if found else {}


def _parts(log: Sequence[LogEntry], *, is_cut_off: bool) -> tuple[PartReport, ...]:
    folds: dict[int, PartFold] = {}
    for entry in log:
        if not entry.part:
            continue  # number 0 stands for no part yet
        try:
            folds.setdefault(entry.part, PartFold(entry.part)).take(entry)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise ResultsError(
                f"journal row {entry.seq} ({entry.kind} {entry.name}) is not what this version of "
                f"cellctl writes: {error!r}; report it with the version that wrote it"
            ) from error
    return tuple(folds[number].report(is_cut_off=is_cut_off) for number in sorted(folds))


def _devices(began: Mapping[str, Any], connected: Mapping[str, Any]) -> tuple[DeviceReport, ...]:
    emulated = set(began.get("emulated_devices", ()))
    return tuple(
        DeviceReport(
            name=name,
            address=str(settings.get("address", "")),
            is_emulated=bool(settings.get("emulated", name in emulated)),
            identity=str(connected.get(name, "")),
        )
        for name, settings in began.get("devices", {}).items()
    )


def _outcome(
    log: Sequence[LogEntry],
    parts: Sequence[PartReport],
    at_rest: Mapping[str, Any],
    broke_off: Mapping[str, Any],
) -> Outcome:
    last = parts[-1] if parts else None
    custody = last.custody if last else Custody.NONE
    where = _where(last)
    # a run may come to rest and still break off while it ends; the later word counts
    if broke_off:
        message = str(broke_off.get("error", ""))
        return Outcome("broke_off", message, "broke_off", custody, where)
    if at_rest:
        end = str(at_rest.get("state", ""))
        if end not in ENDS:
            raise ResultsError(f"the journal says the run ended as {end!r}, which is no state")
        return Outcome(
            cast(End, end),
            str(at_rest.get("message", "")),
            str(at_rest.get("code", "")),
            Custody.__members__.get(str(at_rest.get("custody")), custody),
            str(at_rest.get("where", where)),
        )
    then = f"part {last.number} then was {_held(last)}" if last else "no part was at hand"
    message = (
        f"the run has no end in the journal: it was cut off after “{say_row(log[-1])}” at "
        f"{log[-1].at:%H:%M:%S} UTC (unless it is still running); {then}"
    )
    return Outcome("cut_off", message, "cut_off", custody, where)


def _held(part: PartReport) -> str:
    detail = f" ({part.custody_detail})" if part.custody_detail else ""
    return f"{part.custody.value}{detail}" + (", or no longer" if part.in_doubt else "")


def _where(part: PartReport | None) -> str:
    if part is None:
        return where_it_is(Custody.NONE)
    if part.in_doubt:
        return where_it_is(Custody.UNKNOWN, f"last known: {part.custody.value}")
    return where_it_is(part.custody, part.custody_detail)


def _stages(log: Sequence[LogEntry]) -> tuple[StageReport, ...]:
    """Return how long the cell was in each state, in the order of first entry."""
    spent: dict[str, list[float]] = {}
    state, since = "", 0.0
    for entry in log:
        if entry.kind != "event" or entry.body.get("answer") != "handled":
            continue
        if state:
            spent.setdefault(state, []).append(entry.t_s - since)
        state, since = str(entry.body.get("to", "")), entry.t_s
    if state not in {"", *ENDS}:
        spent.setdefault(state, []).append(log[-1].t_s - since)
    return tuple(StageReport(name, len(times), sum(times)) for name, times in spent.items())
