"""The output of `cellctl run`: progress and result, as JSON lines or for people."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.live import Live
from rich.table import Table

from controller.cell.alarms import device_named
from controller.cell.batch import PartRecord, RunProgress, RunResult
from controller.results.takt import TaktGroup, takt_json, takt_line

from ..terminal.output import (
    emit,
    is_output_behind,
    lost_line_count,
    print_line,
    stderr,
    warn,
    write_error_line,
)

# alarms (docs/alarms.md) that a wrong calibration raises: stalls, and objects found elsewhere than
# expected
MAY_BE_CALIBRATION: Final = frozenset({310, 320, *range(401, 417)})


class _PatientLive(Live):
    """A live table that waits for its reader, and then shows the newest state.

    Streams are left unchanged. Rich would bypass the writer that prevents a stopped terminal from
    holding up the run.
    """

    def __init__(self, **options: Any) -> None:  # noqa: ANN401  (rich's own)
        super().__init__(**options, redirect_stdout=False, redirect_stderr=False)

    def refresh(self) -> None:
        """Draw the table, unless the last one has not been taken yet."""
        if not is_output_behind():
            super().refresh()


@contextmanager
def display(*, as_json: bool) -> Iterator[Callable[[RunProgress], None]]:
    """Yield a function that shows progress: as JSON lines, a live table, or plain lines."""
    if as_json:
        yield _json_progress
    elif stderr.is_terminal:
        with _PatientLive(console=stderr, refresh_per_second=4, transient=True) as live:
            started = time.monotonic()
            yield lambda progress: live.update(_table(progress, time.monotonic() - started))
    else:
        last = [""]

        def plain(progress: RunProgress) -> None:
            line = progress_line(progress)
            if line != last[0]:
                last[0] = line
                write_error_line(line, is_live=True)

        yield plain


def _json_progress(progress: RunProgress) -> None:
    emit(
        {
            "event": "progress",
            "state": progress.state,
            "step": progress.step,
            "step_count": progress.step_count,
            "label": progress.label,
            "part_pose": progress.part_pose,
            "remaining_s": progress.remaining_s,
            "custody": progress.custody.key,
            "speed": None if progress.speed is None else progress.speed.as_json(),
        },
        is_live=True,
    )


def progress_line(progress: RunProgress) -> str:
    """Return the progress of the run in one line, for the operator."""
    step = f" {progress.step}/{progress.step_count}" if progress.step_count else ""
    left = f" ({progress.remaining_s:.0f} s left)" if progress.remaining_s is not None else ""
    pose = f" | {progress.part_pose}" if progress.part_pose else ""
    says_more = progress.label not in ("", progress.state)
    label = f": {progress.label}" if says_more else ""
    return f"{progress.state}{step}{label}{left}{pose}"


def _table(progress: RunProgress, elapsed_s: float) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_row("state", progress.state)
    if progress.step_count:
        done = round(30 * progress.step / progress.step_count)
        bar = "#" * done + "." * (30 - done)
        table.add_row("step", f"{bar} {progress.step} of {progress.step_count}")
    table.add_row("now", progress.label)
    table.add_row("part", progress.part_pose or "-")
    table.add_row("held by", progress.custody.value)
    left = "-" if progress.remaining_s is None else f"{progress.remaining_s:.0f} s of cell time"
    table.add_row("left", f"{left}, {elapsed_s:.0f} s gone")
    if progress.speed is not None:
        table.add_row("speed", str(progress.speed))
    return table


def print_result(
    result: RunResult,
    run_id: str,
    report: Path | None,
    takt: TaktGroup | None = None,
    *,
    as_json: bool,
) -> int:
    """Print the result of a run; return the exit code, 0 if all parts passed.

    Parameters
    ----------
    result : end of the run, and its parts
    run_id : its name
    report : file of its report, None if it could not be written
    takt : share of each use in the arm's time; None if it is unknown
    as_json : print one JSON object instead of sentences
    """
    good = result.outcome.end == "complete" and all(part.tray == "accept" for part in result.parts)
    if as_json:
        emit(
            {
                "event": "result",
                "run": run_id,
                "end": result.outcome.end,
                "code": result.outcome.code,
                "message": result.outcome.message,
                "where": result.outcome.where,
                "alarm": _alarm_json(result),
                "calibration": calibration_note(result),
                "parts": [part_json(part) for part in result.parts],
                "speed": result.speed.as_json(),
                "takt": None if takt is None else takt_json(takt),
                "report": None if report is None else str(report),
                "lost_lines": lost_line_count(),
            }
        )
        return 0 if good else 1
    for part in result.parts:
        if part.verdict is None:
            continue
        verdict = part.verdict.verdict.value.upper()
        print_line(f"part {part.number}{_which(part, result)}: {verdict} -> {part.tray}")
        for one in part.recoveries:
            print_line(f"  recovered from: {one.reason}")
        for reason in part.verdict.reasons[:6]:
            print_line(f"  {reason}")
    if result.outcome.end != "complete":
        warn(f"cellctl: {result.outcome.end}: {result.outcome.message}")
        if result.outcome.end != "refused":  # its message has it
            warn(result.outcome.where)
        if (alarm := result.outcome.alarm) is not None:
            warn(f"alarm {alarm.number} ({alarm.code}). Unknown now: {alarm.unknown}.")
            warn(f"What to do: {alarm.action}.")
        if note := calibration_note(result):
            warn(note)
    print_line(f"speed: {result.speed}")
    if takt is not None and (line := takt_line(takt)):
        print_line(line)
    if report is not None:
        print_line(f"report: {report}")
    return 0 if good else 1


def _which(part: PartRecord, result: RunResult) -> str:
    """Return the part's name in brackets: its recipe if there are several, and its number."""
    recipes = {one.product.number for one in result.parts if one.product is not None}
    name = part.product.recipe.name if part.product is not None and len(recipes) > 1 else ""
    words = ", ".join(word for word in (name, part.serial) if word)
    return f" ({words})" if words else ""


def calibration_note(result: RunResult) -> str:
    """Return a note that a missing calibration may have ended a run; empty if it cannot have.

    Parameters
    ----------
    result : result of the run
    """
    alarm = result.outcome.alarm
    if alarm is None or alarm.number not in MAY_BE_CALIBRATION or not result.why_not_verified:
        return ""
    return (
        f"The cell is not verified: {result.why_not_verified}. A camera or an arm that is "
        "not at its pose in the cell file would give the same result: calibrate the cell "
        "with `cellctl commission`."
    )


def _alarm_json(result: RunResult) -> dict[str, Any] | None:
    """Return the alarm that ended a run (docs/alarms.md), None if all went well."""
    alarm = result.outcome.alarm
    if alarm is None:
        return None
    return {
        "number": alarm.number,
        "code": alarm.code,
        "severity": alarm.severity.value,
        "device": device_named(alarm, result.outcome.message),
        "step": result.outcome.step,
        "unknown": alarm.unknown,
        "action": alarm.action,
    }


def part_json(part: PartRecord) -> dict[str, Any]:
    """Return the results of a part in a run."""
    s = part.sighting
    return {
        "part": part.number,
        "recipe": None if part.product is None else part.product.recipe.name,
        "serial": part.serial or None,
        "lot": part.lot or None,
        "custody": part.custody.key,
        "tray": part.tray,
        "verdict": None if part.verdict is None else part.verdict.verdict.value,
        "reasons": [] if part.verdict is None else list(part.verdict.reasons),
        "covered_fraction": None if part.verdict is None else part.verdict.compared_fraction,
        "views": len(part.results),
        "views_evaluated": sum(r.evaluated for r in part.results),
        "recoveries": [one.fault.value for one in part.recoveries],
        "sighting": None
        if s is None
        else {
            "part": s.part,
            "pose_index": s.pose_index,
            "x_mm": s.x_mm,
            "y_mm": s.y_mm,
            "theta_deg": float(np.degrees(s.theta_rad)),
            "score": s.score,
        },
    }
