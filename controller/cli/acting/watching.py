"""Watching a running cell from another terminal: the display of `cellctl run`, until it ends."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from rich.live import Live
from rich.table import Table

from controller.cell.control import ControlError, NoRunError, RunningCell, StatusReply, facts

from ..terminal.output import emit, print_line, stdout, warn
from .orders import status_lines

LOOK_WALL_S: Final = 0.25  # time between two looks
# longest silence of a run that starts or ends, or whose machine is busy
SILENT_WALL_S: Final = 30.0
BAR_COUNT: Final = 30  # characters of the bar of steps


def watch_cell(
    runs_dir: Path,
    *,
    as_json: bool,
    wait: Callable[[float], None] = time.sleep,
    clock: Callable[[], float] = time.monotonic,
) -> int:
    """Show a running cell until its run ends; return 0.

    The cell is polled for its status only, four times a second.

    Parameters
    ----------
    runs_dir : folder of all runs, by whose lock the run is found
    as_json : print one JSON object for each change instead
    wait, clock : wait and clock in wall seconds

    Raises
    ------
    NoRunError : no run has this cell
    ControlError : it does not answer for half a minute, or not with what it must
    """
    cell, run, answered_s = RunningCell(runs_dir), "", clock()
    with _shown(as_json=as_json) as show:
        while True:
            try:
                found = cell.status()
            except NoRunError:
                if not run:
                    raise
                break
            except ControlError:
                if clock() - answered_s > SILENT_WALL_S:
                    raise
            else:
                if run and found.run != run:
                    break
                run, answered_s = found.run, clock()
                show(found)
            wait(LOOK_WALL_S)
    if as_json:
        emit({"event": "ended", "run": run})
    else:
        print_line(f"run {run} has ended; `cellctl report {run} --runs {runs_dir}` has its result")
    return 0


@contextmanager
def _shown(*, as_json: bool) -> Iterator[Callable[[StatusReply], None]]:
    """Yield the display of a status: in place on a terminal, else one line or object per change."""
    if not as_json and stdout.is_terminal:
        with Live(console=stdout, refresh_per_second=4, transient=True) as live:
            yield lambda found: live.update(_table(found))
        return
    last: list[Any] = [None]

    def changed(found: StatusReply) -> None:
        # the clock and what follows from it alone change all the time
        now = facts(found.model_copy(update={"at_s": None, "seconds_left": None}))
        now.pop("pause_seconds")
        if now == last[0]:
            return
        is_new_alarm = last[0] is None or now["alarms"] != last[0]["alarms"]
        last[0] = now
        if as_json:
            emit({"event": "status", **facts(found)})
            return
        print_line(_line(found))
        if is_new_alarm:
            for alarm in found.alarms:
                warn(f"alarm {alarm}")
        if found.question is not None:
            for line in status_lines(found):
                if line.startswith(("question", "  cellctl answer")):
                    print_line(line)

    yield changed


def _line(found: StatusReply) -> str:
    step = f" {found.step}/{found.step_count}" if found.step_count else ""
    label = f": {found.label}" if found.label else ""
    left = "" if found.seconds_left is None else f" ({found.seconds_left:.0f} s left)"
    return f"{found.state}{step}{label}{left} | {found.custody}"


def _table(found: StatusReply) -> Table:
    table = Table.grid(padding=(0, 2))
    if found.step_count:
        done = round(BAR_COUNT * found.step / found.step_count)
        bar = "#" * done + "." * (BAR_COUNT - done)
        table.add_row("", f"{bar} {found.step} of {found.step_count}")
    for line in status_lines(found):
        table.add_row("", line)
    return table
