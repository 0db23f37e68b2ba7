"""Pauses of a whole run over real wires: does the cell stand within the seconds that it showed?

``python -m benchmarks.bench_pause --pauses 12 --seed 3 --json``. A run of `cellctl run` on an
emulated cell is paused at random moments, in a kind drawn from the seed, through its control socket
alone, and resumed. For each pause: what was going on, the seconds shown before, the cell seconds
until the cell stood (upper bound: status is read every 50 ms), and whether it went on. In the end:
whether the run's verdict and tray are those of the same run without a pause (``--reference``).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from controller.cell.control import (
    ControlError,
    PauseOrder,
    ResumeOrder,
    RunningCell,
    StatusReply,
)

KINDS = ("step", "safe", "now")
LOOK_S = 0.05
GIVE_UP_S = 600.0


def command(args: argparse.Namespace, runs: Path) -> list[str]:
    return [
        sys.executable, "-m", "controller.cli", "run", args.recipe, "--speed", str(args.speed),
        "--seed", str(args.seed), "--runs", str(runs), "--json", "--wait",
    ]  # fmt: skip


def result_of(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, _ = process.communicate()
    last = json.loads(out.strip().splitlines()[-1])
    assert isinstance(last, dict)
    return last


def status_of(cell: RunningCell) -> StatusReply | None:
    try:
        return cell.status()
    except ControlError:
        return None


def await_state(
    cell: RunningCell, process: subprocess.Popen[str], prefix: str
) -> StatusReply | None:
    """Return the first status in a state that begins so; None once the run has ended."""
    until = time.monotonic() + GIVE_UP_S
    while process.poll() is None and time.monotonic() < until:
        found = status_of(cell)
        if found is not None and found.state.startswith(prefix):
            return found
        time.sleep(LOOK_S)
    return None


def one_pause(
    cell: RunningCell, process: subprocess.Popen[str], kind: str
) -> dict[str, Any] | None:
    """Pause and resume a run that is at work; None where it was not at work any more."""
    before = status_of(cell)
    if before is None or not before.state.startswith("execute"):
        return None
    shown_s = before.pause_seconds.get(kind)  # type: ignore[call-overload]
    reply = cell.order("pause", PauseOrder.model_validate({"kind": kind, "why": "bench"}))
    if reply.decision != "handled":
        return None
    stood = await_state(cell, process, "suspended")
    if stood is None or stood.at_s is None or before.at_s is None:
        return {"kind": kind, "state": before.state, "shown_s": shown_s, "took_s": None}
    first = None if stood.first_motion is None else stood.first_motion.words
    gone_on = cell.order("resume", ResumeOrder(why="bench", first=first))
    return {
        "kind": kind,
        "state": before.state,
        "label": before.label,
        "shown_s": shown_s,
        "took_s": round(stood.at_s - before.at_s, 2),
        "point": stood.safe_point,
        "first": first,
        "resumed": gone_on.decision,
    }


def paused_run(args: argparse.Namespace, runs: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    rng = np.random.default_rng(args.draw)
    process = subprocess.Popen(
        command(args, runs), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    cell, rows = RunningCell(runs), []
    while process.poll() is None and len(rows) < args.pauses:
        if await_state(cell, process, "execute") is None:
            break
        time.sleep(float(rng.uniform(0.0, args.gap)))
        try:
            row = one_pause(cell, process, KINDS[int(rng.integers(len(KINDS)))])
        except ControlError:
            break
        if row is not None:
            rows.append(row)
    return rows, result_of(process)


def outcome(result: dict[str, Any]) -> dict[str, Any]:
    return {
        "end": result["end"],
        "parts": [(part["verdict"], part["tray"], part["views"]) for part in result["parts"]],
    }


def table(rows: list[dict[str, Any]]) -> str:
    lines = ["| kind | while | shown s | took s | within |", "|---|---|---|---|---|"]
    lines += [
        f"| {r['kind']} | {r['state']} | {r['shown_s']} | {r['took_s']} | {is_within(r)} |"
        for r in rows
    ]
    return "\n".join(lines)


def is_within(row: dict[str, Any]) -> bool:
    shown, took = row["shown_s"], row["took_s"]
    return shown is not None and took is not None and took <= shown + 0.5  # a look, and a request


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recipe", default="featuretype")
    parser.add_argument("--speed", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=7, help="of the emulated cell")
    parser.add_argument("--draw", type=int, default=1, help="seed of moments and kinds")
    parser.add_argument("--pauses", type=int, default=12)
    parser.add_argument(
        "--gap", type=float, default=8.0, help="wall seconds between pauses at most"
    )
    parser.add_argument("--reference", action="store_true", help="make a run without pauses, too")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows, result = paused_run(args, Path(folder) / "paused")
        found: dict[str, Any] = {"pauses": rows, "paused": outcome(result)}
        if args.reference:
            process = subprocess.Popen(
                command(args, Path(folder) / "plain"),
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            )  # fmt: skip
            found["plain"] = outcome(result_of(process))
            found["same"] = found["plain"] == found["paused"]
    found["within"] = f"{sum(map(is_within, rows))} of {len(rows)}"
    if args.json:
        print(json.dumps(found))
        return
    print(table(rows))
    print(f"stood within the seconds shown: {found['within']}; end: {found['paused']}")
    if args.reference:
        print(f"same result as without a pause: {found['same']}")


if __name__ == "__main__":
    main()
