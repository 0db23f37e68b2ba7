"""SIGKILL a controller that holds a part, start again, and ask the world what was let go.

    python benchmarks/bench_kill.py [--stages presenting handing placing] [--speed 10] [--json]

The emulated cell is a process of its own and lives on. The first controller is killed in a stage;
the second one is started on the same folder of runs. Whether anything moved or was released is the
world's own word (its control port), not the controller's. Then the part is taken out by hand and a
third start, with `--part-removed`, must get past the check.
"""

import argparse
import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from controller.cell.dispatcher import Dispatcher
from controller.cell.journal import JOURNAL_NAME, read_rows
from controller.cell.records import Progress
from controller.cell.run import RunOrder, new_run_id, run_batch
from controller.cell.workers import Job, context, make_pool
from controller.config import load_cell, load_recipe

Ask = Callable[..., dict[str, Any]]

ROOT = Path(__file__).parents[1]
RECIPE = ROOT / "recipes" / "holder.yaml"
SEED = 8
# seconds of the world after the end of the second start, in which a wrong order would still act
WATCH_S = 2.0


# ---- the controller, as a process of its own ----
def victim(ready: dict[str, Any], runs: Path, speed: float, *, removed: bool) -> int:
    """Run the recipe on an emulated cell that is there already; print each state."""
    recipe = load_recipe(RECIPE)
    cell = load_cell(recipe.cell)
    order = RunOrder(
        recipe_path=RECIPE,
        cell_path=recipe.cell,
        recipe=recipe,
        cell=cell,
        count=1,
        speed=speed,
        emulated=ready,
        runs_dir=runs,
        run_id=new_run_id(recipe),
        is_part_removed=removed,
    )
    last = [""]

    def show(progress: Progress) -> None:
        if progress.state != last[0]:
            last[0] = progress.state
            print(json.dumps({"state": progress.state}), flush=True)

    def nothing(dispatcher: Dispatcher) -> None:
        """Take no notice of it."""

    with make_pool() as pool:
        pool.submit(context, Job(RECIPE, recipe.cell))
        result = asyncio.run(run_batch(order, pool, show, nothing))
    end = {"end": result.outcome.end, "message": result.outcome.message}
    print(json.dumps(end), flush=True)
    return 0 if result.outcome.end == "complete" else 1


def start(ready: dict[str, Any], runs: Path, speed: float, *more: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [
            sys.executable, __file__, "--victim", json.dumps(ready),
            "--runs", str(runs), "--speed", f"{speed:g}", *more,
        ],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def lines_of(process: "subprocess.Popen[str]") -> Iterator[dict[str, Any]]:
    assert process.stdout is not None
    for line in process.stdout:
        yield json.loads(line)


# ---- the world ----
@contextmanager
def world(folder: Path, speed: float) -> Iterator[tuple[dict[str, Any], Ask]]:
    """Yield what the emulator says of itself, and its control port."""
    port = folder / "control.sock"
    process = subprocess.Popen(
        [
            sys.executable, "-m", "emulators", "--cell", "recipes/cells/emulated.yaml",
            "--part", "recipes/parts/holder.stl", "--seed", str(SEED), "--speed", f"{speed:g}",
            "--control", str(port),
        ],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    assert process.stdout is not None

    def ask(do: str, **order: object) -> dict[str, Any]:
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(30)
            line.connect(str(port))
            with line.makefile("rwb") as file:
                file.write(json.dumps({"do": do, **order}).encode() + b"\n")
                file.flush()
                answer: dict[str, Any] = json.loads(file.readline())
        assert answer.pop("ok"), answer
        return answer

    try:
        yield json.loads(process.stdout.readline()), ask
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


def released(truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what was let go while nobody else held it."""
    return [e for e in truth["events"] if e["what"] in ("released", "lost") and not e["is_held"]]


def wait_world(ask: Ask, seconds: float) -> dict[str, Any]:
    """Return the truth after so many world seconds."""
    truth: dict[str, Any] = ask("truth")
    until = truth["time_s"] + seconds
    while truth["time_s"] < until:
        time.sleep(0.02)
        truth = ask("truth")
    return truth


# ---- one kill ----
def kill_in(stage: str, speed: float, folder: Path) -> dict[str, Any]:
    """Kill a controller in a stage, start again, and return what happened."""
    runs = folder / "runs"
    with world(folder, speed) as (ready, ask):
        first = start(ready, runs, speed)
        with first:
            for line in lines_of(first):
                print(f"  {stage}: {line}", file=sys.stderr, flush=True)
                if line.get("state") == stage:
                    # in the middle of it, while something moves
                    begun = ask("truth")
                    while ask("truth")["last_motion_s"] == begun["last_motion_s"]:
                        time.sleep(0.005)
                    os.kill(first.pid, signal.SIGKILL)
                    break
            first.wait()
        killed = ask("truth")
        second = start(ready, runs, speed)
        with second:
            said = list(lines_of(second))
        truth = wait_world(ask, WATCH_S)
        halted_s = max(truth["last_motion_s"].values())
        rows = list(read_rows(runs / JOURNAL_NAME))
        asked_s = _world_time_of(rows, ready, speed, "openings")
        outcome = {
            "stage": stage,
            "custody_of_the_world": killed["parts"][0]["custody"],
            "height_mm": _height(killed),
            "exit_code": second.returncode,
            "end": said[-1].get("end"),
            "message": said[-1].get("message"),
            "released_by_the_start": len(released(truth)) - len(released(killed)),
            "still_held_as_before": truth["parts"][0]["custody"] == killed["parts"][0]["custody"],
            "jaws_moved": any(
                truth["last_motion_s"][name] > asked_s for name in ("arm gripper", "fixed gripper")
            ),
            "arm_moved_after_the_halt": truth["last_motion_s"]["arm"] > asked_s,
            "went_on_s": round(max(0.0, halted_s - killed["time_s"]), 2),
        }
        # the operator takes the part out by hand and says so
        for gripper in ("arm", "fixture"):
            ask("lose_part", gripper=gripper)
        ask("remove")
        wait_world(ask, 3.0)
        third = start(ready, runs, speed, "--part-removed")
        with third:
            for line in lines_of(third):
                if line.get("state") == "acquiring":
                    break
                if "end" in line:
                    outcome["message_after_removal"] = line["message"]
            third.kill()
        outcome["goes_on_with_part_removed"] = "message_after_removal" not in outcome
    outcome["ok"] = (
        outcome["exit_code"] == 1
        and outcome["end"] == "refused"
        and outcome["released_by_the_start"] == 0
        and outcome["still_held_as_before"]
        and not outcome["jaws_moved"]
        and not outcome["arm_moved_after_the_halt"]
        and outcome["goes_on_with_part_removed"]
    )
    return outcome


def _height(truth: dict[str, Any]) -> float | None:
    T = truth["parts"][0]["T_world_part"]
    return None if T is None else round(T[2][3], 1)


def _world_time_of(rows: list[Any], ready: dict[str, Any], speed: float, name: str) -> float:
    """Return when a row was written [world s]: the emulator's clock began at its own start."""
    at = [row.t_mono_s for row in rows if row.name == name][-1]
    return (at - float(ready["started_wall_s"])) * speed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stages", nargs="+", default=["presenting", "handing", "placing"])
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--victim", help=argparse.SUPPRESS)
    parser.add_argument("--runs", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--part-removed", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.victim:
        return victim(json.loads(args.victim), args.runs, args.speed, removed=args.part_removed)
    outcomes = []
    for stage in args.stages:
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(kill_in(stage, args.speed, Path(folder)))
        if not args.json:
            one = outcomes[-1]
            print(f"killed in {stage}: {'ok' if one['ok'] else 'NOT OK'}")
            for name, value in one.items():
                print(f"  {name:26} {value}")
    if args.json:
        print(json.dumps({"bench": "kill", "kills": outcomes}))
    return 0 if all(one["ok"] for one in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
