"""Whole runs for `bench_runs.py`: `cellctl run` with pictures, recognition and inspection."""

import argparse
import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from runs_record import Ran, line_of, load, read_journal, read_world

from controller.cell.journal import read_rows

ROOT = Path(__file__).parents[1]
RUN_LIMIT_WALL_S = 600.0


def run_whole(args: argparse.Namespace, scratch: Path) -> None:
    """Make whole runs: `cellctl run` with pictures, recognition and inspection."""
    for number in range(args.count):
        recipe = args.parts[number % len(args.parts)]
        if not (ROOT / f"recipes/{recipe}.yaml").is_file():
            continue
        seed = args.seed + number
        key = f"whole-{recipe}/-1/{seed}"
        if key in {ran.key for ran in load(args.out)}:
            continue
        ran = _one_whole(key, recipe, seed, args, scratch)
        with args.out.open("a") as file:
            file.write(json.dumps(asdict(ran)) + "\n")
        print(line_of(ran), flush=True)


def _one_whole(key: str, recipe: str, seed: int, args: argparse.Namespace, scratch: Path) -> Ran:
    control, runs = scratch / "control.sock", scratch / f"runs-{seed}"
    control.unlink(missing_ok=True)
    command = [
        sys.executable, "-m", "controller.cli", "run", f"recipes/{recipe}.yaml", "--json",
        "--speed", f"{args.speed:g}", "--seed", str(seed), "--runs", str(runs),
        "--control", str(control),
    ]  # fmt: skip
    rng = np.random.default_rng(seed)
    started = time.monotonic()
    ran = Ran(key, recipe, -1, seed)
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    limit = threading.Timer(RUN_LIMIT_WALL_S, process.kill)
    limit.start()
    result: dict[str, Any] = {}
    last: tuple[object, ...] = ()
    assert process.stdout is not None
    for line in process.stdout:
        body = json.loads(line)
        if body["event"] == "result":
            result = body
            continue
        step = (body["state"], body["step"])
        if body["state"] in ("completing", "complete"):
            _whole_truth(ran, control)
        elif (body["custody"], body["state"]) == ("in_arm", "presenting") and step != last:
            is_unlucky = rng.uniform() < args.fault_rate
            if is_unlucky:
                _whole_fault(ran, control, rng)
        last = step
    limit.cancel()
    process.wait()
    ran.wall_s = round(time.monotonic() - started, 1)
    if not result:
        ran.end = "no result"
        return ran
    ran.end, ran.code, ran.message = result["end"], result["code"], result["message"]
    for part in result["parts"]:
        ran.verdict, ran.tray, ran.views = part["verdict"], part["tray"], part["views"]
        ran.covered = round(part["covered_fraction"] or 0.0, 4)
    rows = list(read_rows(runs / "journal.sqlite"))
    ran.recoveries = [r.body["trouble"] for r in rows if r.name == "recovery"]
    ran.plans = sum(r.kind == "decision" and r.name == "plan" for r in rows)
    read_journal(ran, rows)
    return ran


def _whole_truth(ran: Ran, control: Path) -> None:
    with contextlib.suppress(OSError, ValueError):
        truth = ask(control, "truth")
        read_world(ran, {"collisions": [], "events": []}, truth)


def _whole_fault(ran: Ran, control: Path, rng: np.random.Generator) -> None:
    if rng.uniform() < 0.5:
        ask(control, "lose_part")
        ran.faults.append("drop from arm")
        return
    along = float(rng.uniform(2.0, 8.0) * rng.choice([-1.0, 1.0]))
    ask(control, "slip", along_mm=along)
    ran.faults.append(f"slip in arm {along:+.1f} mm")


def run_beside(
    command: Sequence[str],
    log: Path,
    limit_wall_s: float,
    person: Callable[[int, threading.Event], None],
) -> dict[str, Any]:
    """Make one run with `--json`, and let a person look at it and act all the while.

    Parameters
    ----------
    command : of the run
    log : file for what it prints as errors
    limit_wall_s : it is killed after so long
    person : called in a thread of its own, with the run's process id and what is set at its end

    Returns
    -------
    the run's result; empty where it printed none
    """
    result: dict[str, Any] = {}
    has_ended = threading.Event()
    with log.open("w") as errors:
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=errors, text=True
        )
    limit = threading.Timer(limit_wall_s, process.kill)
    limit.start()
    beside = threading.Thread(target=person, args=(process.pid, has_ended))
    beside.start()
    assert process.stdout is not None
    for line in process.stdout:
        body = json.loads(line)
        if body["event"] == "result":
            result = body
    process.wait()
    has_ended.set()
    beside.join()
    limit.cancel()
    return result


def ask(control: Path, do: str, **order: object) -> dict[str, Any]:
    """Send one order to a control port and return the answer."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(10)
        line.connect(str(control))
        with line.makefile("rwb") as file:
            file.write(json.dumps({"do": do, **order}).encode() + b"\n")
            file.flush()
            return dict(json.loads(file.readline()))
