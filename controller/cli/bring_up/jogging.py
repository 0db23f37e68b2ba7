"""`cellctl jog`: enter the cell, and have a person or a script move it."""

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from controller.bring_up.jogging import JogOrders, JogSession, TakenOver
from controller.bring_up.procedure import StepEnd, StepRecord
from controller.config import Cell, ConfigError, load_cell
from controller.setup.drivers import require_drivers

from ..running.entering import check_entering, entered, user_name
from ..terminal.output import emit, print_line, warn
from .arguments import JogOptions
from .pilots import KeyPilot, LinePilot, script_text

STDIN: Final = Path("-")


def jog_cell(options: JogOptions) -> int:
    """Move the cell by orders; return 0 if all ended well, 1 if something stopped it.

    Raises
    ------
    ConfigError : a file or an option is wrong
    """
    cell = load_cell(options.cell_path)
    check_jog(options, cell)
    record, _ = run_jog(options, cell, None)
    return 0 if record.outcome is StepEnd.PASSED else 1


def check_jog(options: JogOptions, cell: Cell) -> None:
    """Check all that can be checked before anything starts.

    Raises
    ------
    ConfigError : a file or an option is wrong
    CellError : another process has the cell
    """
    require_drivers(options.cell_path, cell)
    if options.commands is None:
        if options.as_json:
            raise ConfigError("--json requires --commands: keys need a terminal")
        if not (sys.stdin.isatty() and sys.stdout.isatty()):
            raise ConfigError(
                "standard input or output is no terminal: start it in one, or give orders by "
                "--commands FILE (`-` for standard input)"
            )
        if options.answers:
            raise ConfigError("--yes requires --commands: at a terminal you answer yourself")
    elif options.commands != STDIN:
        script_text(options.commands)
    check_entering(options.emulated, cell, options.runs_dir, "--runs", answers=options.answers)


def run_jog(
    options: JogOptions, cell: Cell, accept: Callable[[TakenOver], str] | None
) -> tuple[StepRecord, TakenOver | None]:
    """Move the cell by orders; return the record of the step, and the position taken.

    Parameters
    ----------
    options : options of the command line
    cell : as its file has it
    accept : check: returns the reason why a position cannot be taken, empty if it can; None takes
        none
    """
    with entered(
        options.emulated, options.cell_path, cell, options.runs_dir, options.name
    ) as inside:
        by = options.operator or user_name()

        async def drive() -> tuple[StepRecord, TakenOver | None]:
            with _pilot(options, by) as pilot:
                session = JogSession(
                    JogOrders(
                        cell=cell,
                        emulated=inside.ready,
                        clock=inside.clock,
                        folder=options.runs_dir,
                        by=by,
                        recipe=options.name,
                    ),
                    pilot,
                    accept,
                )
                with inside.ends.stopping(session, inside.ready.get("pid")):
                    return await session.run(), session.taken

        record, taken = asyncio.run(drive())
        _report(record, options)
        return record, taken


@contextmanager
def _pilot(options: JogOptions, by: str) -> Iterator[KeyPilot | LinePilot]:
    if options.commands is None:
        keys = KeyPilot(by, sys.stdin.fileno(), options.takes)
        with keys.heard():
            yield keys
        return
    lines = LinePilot(answers=options.answers, as_json=options.as_json)
    with lines.heard(None if options.commands == STDIN else options.commands):
        yield lines


def _report(record: StepRecord, options: JogOptions) -> None:
    if options.as_json:
        emit({"event": "end", "outcome": record.outcome.value, "message": record.message})
    elif record.outcome is StepEnd.PASSED:
        print_line(f"{options.name}: ended; the arm has halted")
    else:
        warn(f"cellctl: {record.message}")
