"""`cellctl commission`: check, start the emulated cell if any, run the steps, write the page."""

import asyncio
import getpass
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from controller.cell.commissioning import CommissionOrder, EmulatedPerson, Session, due
from controller.cell.control import socket_path
from controller.cell.devices.clocks import find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_args, emulator_command
from controller.cell.devices.lock import Holder, hold_cell, require_free_cell
from controller.commissioning.procedure import Folder, Outcome, Standing, Status, StepRecord
from controller.config import Cell, ConfigError
from controller.results.commissioned import write_evidence_page
from controller.setup.drivers import require_drivers

from ..devices.doctor_checks import machine_checks
from ..inputs.checks import MIN_FREE_BYTES, check_control, check_writable_folder
from ..running.door import OperatorDoor
from ..running.ends import Ends
from ..terminal.output import emit, print_line, warn

RUN_NAME: Final = "commission"


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedOptions:
    """The command line of `cellctl commission`.

    Attributes
    ----------
    cell_path : cell file as drawn
    out : folder of what is found, None for commissioning/NAME
    step : the one to repeat, None for all that are due
    answers : a helper answers for the person
    operator : who commissions, empty for the user
    as_built, seed, speed : of the emulated cell
    control : unix socket of the emulated cell's control port, None for one of our own
    as_json : print JSON lines
    """

    cell_path: Path
    out: Path | None
    step: str | None
    answers: bool
    operator: str
    as_built: int | None
    seed: int | None
    speed: float
    control: Path | None
    as_json: bool


def guide(options: GuidedOptions, *, status_only: bool) -> int:
    """Run the steps that are due, or print what holds of them; return 0 if all are done.

    Raises
    ------
    ConfigError : a file or an option is wrong
    """
    order = _order(options)
    standings = order.standings(datetime.now(UTC))
    if status_only:
        _report_standings(standings, order, as_json=options.as_json)
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
    return 0 if is_whole and all(one.outcome is Outcome.PASSED for one in records) else 1


def _order(options: GuidedOptions) -> CommissionOrder:
    order = CommissionOrder(options.cell_path, Folder(Path()), "")
    name = order.nominal().name
    out = options.out or Path("commissioning") / name
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out {out}: is a file; name a folder")
    return CommissionOrder(options.cell_path, Folder(out), options.operator or _user())


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container may have no name for its user
        return ""


def _check(options: GuidedOptions, cell: Cell, out: Path) -> None:
    """Check what can be checked before anything starts."""
    check_writable_folder(out, "--out", MIN_FREE_BYTES)
    require_free_cell(out, cell)
    check_control(options.control)
    is_emulated = find_clock(cell, {}).path is not None or (
        len(cell.emulated_devices) == len(type(cell.devices).model_fields)
    )
    if options.answers and not is_emulated:
        raise ConfigError(
            "--yes answers for a person, and this cell has real devices: somebody has to stand "
            "at the emergency stop. Start it in a terminal, without --yes"
        )
    if not cell.emulated_devices:
        given = {
            "--as-built": options.as_built,
            "--seed": options.seed,
            "--speed": None if options.speed == 1.0 else options.speed,
        }
        for option, value in given.items():
            if value is not None:
                raise ConfigError(
                    f"{option}: none of this cell's devices is `emulated`; leave it out"
                )
        if options.answers and options.control is None:
            raise ConfigError(
                "--yes needs hands in the emulated cell: give the socket of `cellctl emulate "
                "--control FILE` by --control"
            )
    for check in machine_checks(cell):
        if not check["ok"]:
            raise ConfigError(f"{check['check']}: {check['found']}: {check['remedy']}")


def _run(
    options: GuidedOptions, order: CommissionOrder, cell: Cell, steps: Sequence[str]
) -> tuple[StepRecord, ...]:
    out = order.folder.path
    out.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        ends = stack.enter_context(Ends().heard())
        holder = stack.enter_context(hold_cell(out, cell, RUN_NAME, socket_path(out)))
        control = options.control
        if control is None:
            # short, whatever the folder is called: the name of a socket has 107 bytes at most
            place = stack.enter_context(tempfile.TemporaryDirectory(prefix="cellctl-"))
            control = Path(place) / "control"
        begun: Any = nullcontext({})
        if cell.emulated_devices:
            more = emulator_args(None, None, control, options.as_built)
            command = emulator_command(
                options.cell_path, (), speed=options.speed, seed=options.seed, more=more
            )
            begun = emulated_cell(command, out / "emulator.log")
            warn(f"EMULATED: {', '.join(cell.emulated_devices)} ({options.speed:g} x real time)")
        ready = stack.enter_context(begun)
        helper = EmulatedPerson(control) if options.answers else None
        return asyncio.run(_drive(options, order, cell, steps, ready, holder, ends, helper))


async def _drive(
    options: GuidedOptions,
    order: CommissionOrder,
    cell: Cell,
    steps: Sequence[str],
    ready: dict[str, Any],
    holder: Holder,
    ends: Ends,
    helper: EmulatedPerson | None,
) -> tuple[StepRecord, ...]:
    door = OperatorDoor(order.folder.path, holder, helper, waits=False, as_json=options.as_json)
    clock = find_clock(cell, ready)
    if cell.emulated_devices and clock.path is not None:
        clock = replace(clock, speed=options.speed)

    def show(text: str) -> None:
        if options.as_json:
            emit({"event": "note", "text": text})
        else:
            print_line(f"  {text}")

    def on_step(record: StepRecord) -> None:
        _report_step(record, as_json=options.as_json)

    session = Session(order, ready, clock, door, helper, show)
    async with door.open():
        with ends.stopping(session, ready.get("pid")):
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
    style = None if record.outcome is Outcome.PASSED else "bold red"
    print_line(f"{text}: {record.message}" if record.message else text, style=style)


def _report_standings(
    standings: Sequence[Standing], order: CommissionOrder, *, as_json: bool
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
        style = None if one.status is Status.DONE else "yellow"
        print_line(f"  {one.step:10} {one.status.value:9} {one.reason}", style=style)


def _all_done(standings: Sequence[Standing]) -> bool:
    return all(one.status is Status.DONE for one in standings)
