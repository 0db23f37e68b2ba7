"""`cellctl commission`: check, start the emulated cell if any, run the steps, write the page."""

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from controller.bring_up import CommissioningSession, CommissionOrder, EmulatedPerson, due
from controller.bring_up.evidence_page import write_evidence_page
from controller.bring_up.procedure import (
    CommissioningFolder,
    StepEnd,
    StepRecord,
    StepStanding,
    StepStatus,
)
from controller.config import Cell, ConfigError, load_recipe
from controller.setup.drivers import require_drivers

from ..running.door import OperatorDoor
from ..running.entering import Entered, check_entering, entered, user_name
from ..terminal.output import emit, print_line
from .arguments import GuidedOptions
from .calibration_lines import calibration_lines

RUN_NAME: Final = "commission"


def guide(options: GuidedOptions) -> int:
    """Run the steps that are due, or print their state; return 0 if all are done.

    Raises
    ------
    ConfigError : a file or an option is wrong
    """
    order = _order(options)
    standings = order.standings(datetime.now(UTC))
    if options.status:
        _report_standings(standings, order, as_json=options.as_json)
        _report_calibrations(order, options.runs_dir, as_json=options.as_json)
        return 0 if _all_done(standings) else 1
    steps = due(standings, options.step)
    if not steps:
        _report_standings(standings, order, as_json=options.as_json)
        return 0
    cell = order.nominal()
    require_drivers(options.cell_path, cell)
    _check(options, cell, order.folder.path)
    records = _run(options, order, cell, steps)
    page = _write_page(order)
    if not options.as_json:
        print_line(f"evidence: {page}")
        if order.folder.cell_file.exists():
            print_line(f"cell file as commissioned: {order.folder.cell_file}")
    standings = order.standings(datetime.now(UTC))
    _report_standings(standings, order, as_json=options.as_json)
    is_whole = len(records) == len(steps)
    return 0 if is_whole and all(one.outcome is StepEnd.PASSED for one in records) else 1


def _order(options: GuidedOptions) -> CommissionOrder:
    order = CommissionOrder(options.cell_path, CommissioningFolder(Path()), "")
    name = order.nominal().name
    out = options.out or Path("commissioning") / name
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out {out}: is a file; name a folder")
    recipes = options.recipes or recipes_beside(options.cell_path)
    for one in options.recipes or ():
        load_recipe(one)  # before anything starts
    return CommissionOrder(
        options.cell_path, CommissioningFolder(out), options.operator or user_name(), tuple(recipes)
    )


def recipes_beside(cell_path: Path) -> tuple[Path, ...]:
    """Return the sound recipes in a cell file's folder, by name."""
    found = []
    for path in sorted(cell_path.parent.glob("*.yaml")):
        with suppress(ConfigError):  # no recipe; whatever it is, nobody named it
            load_recipe(path)
            found.append(path)
    return tuple(found)


def _check(options: GuidedOptions, cell: Cell, out: Path) -> None:
    """Check everything that can be checked before the start."""
    check_entering(options.emulated, cell, out, "--out", answers=options.answers)
    if options.answers and not cell.emulated_devices and options.emulated.control is None:
        raise ConfigError(
            "--yes needs hands in the emulated cell: give the socket of `cellctl emulate "
            "--control FILE` by --control"
        )


def _run(
    options: GuidedOptions, order: CommissionOrder, cell: Cell, steps: Sequence[str]
) -> tuple[StepRecord, ...]:
    with entered(options.emulated, options.cell_path, cell, order.folder.path, RUN_NAME) as inside:
        return asyncio.run(_drive(options, order, steps, inside))


async def _drive(
    options: GuidedOptions, order: CommissionOrder, steps: Sequence[str], inside: Entered
) -> tuple[StepRecord, ...]:
    helper = EmulatedPerson(inside.control) if options.answers else None
    door = OperatorDoor(
        order.folder.path, inside.holder, helper, waits=False, as_json=options.as_json
    )

    def show(text: str) -> None:
        if options.as_json:
            emit({"event": "note", "text": text})
        else:
            print_line(f"  {text}")

    def on_step(record: StepRecord) -> None:
        _report_step(record, as_json=options.as_json)

    async with door.open():
        session = CommissioningSession(
            order, inside.ready, inside.clock, door, helper, show, callers=door.callers
        )
        door.attach_stop(session.request_stop)
        with inside.ends.stopping(session, inside.ready.get("pid")):
            return await session.run(steps, on_step)


def _write_page(order: CommissionOrder) -> Path:
    return write_evidence_page(
        order.folder, order.standings(datetime.now(UTC)), order.nominal().name
    )


# -- what people and programs read -------------------------------------------------------------
def _report_step(record: StepRecord, *, as_json: bool) -> None:
    if as_json:
        emit({"event": "step", **record.model_dump(mode="json", by_alias=True)})
        return
    text = f"step {record.step}: {record.outcome.value}"
    style = None if record.outcome is StepEnd.PASSED else "bold red"
    print_line(f"{text}: {record.message}" if record.message else text, style=style)


def _report_standings(
    standings: Sequence[StepStanding], order: CommissionOrder, *, as_json: bool
) -> None:
    if as_json:
        for one in standings:
            emit(
                {
                    "event": "standing",
                    "step": one.step,
                    "status": one.status.value,
                    "reason": one.reason,
                }
            )
        return
    print_line(f"{order.folder.path}:")
    for one in standings:
        style = None if one.status is StepStatus.DONE else "yellow"
        print_line(f"  {one.step:10} {one.status.value:9} {one.reason}", style=style)


def _report_calibrations(order: CommissionOrder, runs: Path, *, as_json: bool) -> None:
    lines = calibration_lines(order.folder, runs, datetime.now(UTC))
    if lines and not as_json:
        print_line(f"calibrations (runs of {runs}):")
    for one in lines:
        if as_json:
            emit(
                {
                    "event": "calibration",
                    "name": one.name,
                    "measured": one.measured.isoformat(),
                    "why_stale": one.why_stale,
                    "run_count": one.run_count,
                    "valid_runs": one.valid_runs,
                    "runs_left": one.runs_left,
                }
            )
        else:
            print_line(f"  {one.name:13} {one.words}", style="yellow" if one.why_stale else None)


def _all_done(standings: Sequence[StepStanding]) -> bool:
    return all(one.status is StepStatus.DONE for one in standings)
