"""How long is the cell blind while something keeps the controller late?

    python benchmarks/bench_blind.py --trials 6 --seed 1 [--json]      a few minutes
    python benchmarks/bench_blind.py --all [--json]                    every combination, hours
    python benchmarks/bench_blind.py --faults output disk --stages homing --events door

`cellctl run` on real wires, on an emulated cell whose time waits for nobody (``--wall-clock``, ADR
14). Once the run is in a stage, and a random moment later, something makes the controller late;
``--lead`` later comes an event that must stop the arm. Counted is from that event to the last bit
of the first stop that each board of the arm has heard, on the clock of the cell and as the emulator
heard it (verb ``arm_stops``); for SIGSTOP, from it to the loss of motor power.

Asked: 0.3 s (p99) to the stop of both boards, 1 s to the loss of power. A trial without a stop
within GIVE_UP_S counts as that long.
"""

import argparse
import itertools
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from bench import Arguments, note, show
from blind_disk import FLAG_VARIABLE, FOLDER_VARIABLE, build_shim
from kill_world import ROOT, KillWorld, kill_world

from controller.cell.control import ControlError, Order, RunningCell
from controller.cell.journal import JOURNAL_NAME
from drivers.clock import CellClock

RECIPE, PART, CELL_SEED = "recipes/holder.yaml", "recipes/parts/holder.stl", 3
LEAD_S: Final = 0.3  # from the fault to the event [s]
GIVE_UP_S: Final = 10.0  # after the event [s]
PAUSE_S: Final = 2.0  # of a pause by the garbage collector [s]
STAGE_LIMIT_S: Final = 900.0  # a guard against a hang [s]
STOP_ASKED_S, POWER_ASKED_S = 0.3, 1.0


@dataclass(frozen=True)
class Stage:
    """A stage of a run.

    Attributes
    ----------
    state, label, custody : what progress shows in it; a label is shown by how it begins
    within_s : the random moment comes so long after its beginning at most [s]
    """

    state: str
    label: str
    custody: str
    within_s: float

    def has_begun(self, progress: dict[str, Any]) -> bool:
        """Return whether a line of progress is of this stage."""
        return (
            progress.get("state") == self.state
            and progress["label"].startswith(self.label)
            and progress["custody"].startswith(self.custody)
        )


STAGES: Final = {
    "homing": Stage("resetting", "homing", "", 15.0),
    "moving": Stage("presenting", "show", "in_arm", 3.0),
    "hand_off": Stage("handing", "hand off", "in_arm", 4.0),
    "placing": Stage("placing", "", "in_arm", 3.0),
}


class Run:
    """A `cellctl run` on a terminal, and the progress it prints."""

    def __init__(self, world: KillWorld, folder: Path) -> None:
        self.runs = folder / "runs"
        self.flag = folder / "disk_stalls"
        self._pausing, pausing = os.pipe()
        self.terminal, self.line = os.openpty()
        os.set_inheritable(self._pausing, True)
        self._pause_by = pausing
        attributes = termios.tcgetattr(self.line)
        attributes[1] &= ~termios.OPOST
        termios.tcsetattr(self.line, termios.TCSANOW, attributes)
        self.process = subprocess.Popen(
            [
                sys.executable, str(Path(__file__).with_name("blind_run.py")), str(self._pausing),
                "run", RECIPE, "--cell", str(world.cell), "--runs", str(self.runs), "--json",
            ],
            cwd=ROOT,
            env=os.environ
            | {
                "PYTHONPATH": str(ROOT),
                "LD_PRELOAD": str(build_shim(folder)),
                FLAG_VARIABLE: str(self.flag),
                FOLDER_VARIABLE: str(self.runs),
            },
            stdin=subprocess.DEVNULL,
            stdout=self.line,
            stderr=self.line,
            pass_fds=(self._pausing,),
            start_new_session=True,
        )  # fmt: skip
        self.seen: list[str] = []
        self._news = threading.Condition()
        self._progress: list[dict[str, Any]] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        left = b""
        while True:
            try:
                data = os.read(self.terminal, 65536)
            except OSError:
                data = b""
            if not data:
                return
            *lines, left = (left + data).split(b"\n")
            with self._news:
                for line in lines:
                    self.seen.append(line.decode(errors="replace"))
                    with suppress(ValueError):
                        self._progress.append(json.loads(line))
                self._news.notify_all()

    def until(self, stage: Stage) -> bool:
        """Wait for a stage; return whether it came."""
        until = time.monotonic() + STAGE_LIMIT_S
        passed = 0
        while time.monotonic() < until:
            with self._news:
                news = self._progress[passed:]
                passed += len(news)
                if any(one.get("event") == "progress" and stage.has_begun(one) for one in news):
                    return True
                if self.process.poll() is not None:
                    return False
                self._news.wait(0.2)
        return False

    def workers(self) -> list[int]:
        """Return the processes that the run has started."""
        task = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return [int(pid) for pid in task.read_text().split()]

    def pause(self, seconds: float) -> None:
        """Keep every thread of the interpreter for so long, as its garbage collector does."""
        os.write(self._pause_by, f"{seconds}\n".encode())

    def close(self) -> None:
        """End it and whatever it has started."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGCONT)
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for fd in (self._pausing, self._pause_by, self.line, self.terminal):
            os.close(fd)


# --- what makes it late -------------------------------------------------------------------------


@contextmanager
def nothing(run: Run) -> Iterator[None]:
    """Leave it alone: what a stop takes by itself."""
    yield


@contextmanager
def blocked_output(run: Run) -> Iterator[None]:
    """Press Ctrl-S in its terminal."""
    termios.tcflow(run.line, termios.TCOOFF)
    try:
        yield
    finally:
        termios.tcflow(run.line, termios.TCOON)


@contextmanager
def stalled_disk(run: Run) -> Iterator[None]:
    """Let no write to the runs' folder come to its end."""
    run.flag.touch()
    try:
        yield
    finally:
        run.flag.unlink()


@contextmanager
def locked_database(run: Run) -> Iterator[None]:
    """Take the write lock of the journal in another process, as a browser of databases may."""
    with sqlite3.connect(run.runs / JOURNAL_NAME, timeout=30.0, isolation_level=None) as other:
        other.execute("BEGIN IMMEDIATE")
        try:
            yield
        finally:
            other.execute("ROLLBACK")
    other.close()


@contextmanager
def stopped(run: Run) -> Iterator[None]:
    """Stop the process that controls the cell."""
    os.kill(run.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(run.process.pid, signal.SIGCONT)


@contextmanager
def collected(run: Run) -> Iterator[None]:
    """Let its garbage collector take its time."""
    run.pause(PAUSE_S)
    yield


@contextmanager
def slow_worker(run: Run) -> Iterator[None]:
    """Stop the processes that compute for it."""
    workers = run.workers()
    for pid in workers:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in workers:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)


FAULTS: Final = {
    "none": nothing,
    "output": blocked_output,
    "disk": stalled_disk,
    "database": locked_database,
    "sigstop": stopped,
    "gc": collected,
    "worker": slow_worker,
}


# --- what must stop the arm ---------------------------------------------------------------------


def press_stop(run: Run, world: KillWorld) -> None:
    """Ask for a stop at the control socket; a blind controller does not answer."""

    def ask() -> None:
        with suppress(ControlError):
            RunningCell(run.runs).order("stop", Order(why="bench_blind"))

    threading.Thread(target=ask, daemon=True).start()


EVENTS: Final[dict[str, Callable[[Run, KillWorld], object]]] = {
    "door": lambda run, world: world.ask("door", closed=False),
    "stop": press_stop,
    "sigterm": lambda run, world: os.kill(run.process.pid, signal.SIGTERM),
    "estop": lambda run, world: world.ask("estop"),
}


@dataclass
class Trial:
    """One event in a late controller.

    Attributes
    ----------
    stop_s : from the event to the stop that the slower board has heard; None for none [cell s]
    power_off_s : from the fault to the loss of motor power; None for none [cell s]
    """

    fault: str
    stage: str
    event: str
    seed: int
    stop_s: float | None = None
    power_off_s: float | None = None
    problem: str = ""


def try_it(
    fault: str, stage: str, event: str, seed: int, watchdog_s: float, lead_s: float = LEAD_S
) -> Trial:
    """Bring up a cell, make its controller late, let something happen, and see."""
    trial = Trial(fault, stage, event, seed)
    delay_s = random.Random(seed).uniform(0.0, STAGES[stage].within_s)
    with tempfile.TemporaryDirectory(prefix="blind") as name:
        folder = Path(name)
        settings = f"{{motor_relay: 0, watchdog_s: {watchdog_s:g}}}" if watchdog_s else ""
        wall = kill_world(
            folder,
            PART,
            seed=CELL_SEED,
            speed=1.0,
            more=("--wall-clock",),
            io_settings=settings,
        )
        with wall as world:
            run, clock = Run(world, folder), CellClock.of_emulator(world.clock)
            try:
                if run.until(STAGES[stage]):
                    time.sleep(delay_s)
                    _observe(trial, run, world, clock, lead_s)
                else:
                    trial.problem = f"never came to this stage: {' / '.join(run.seen[-2:])[:300]}"
            finally:
                clock.close()
                run.close()
    return trial


def _observe(trial: Trial, run: Run, world: KillWorld, clock: CellClock, lead_s: float) -> None:
    late_from_s = clock.now_s()
    with FAULTS[trial.fault](run):
        time.sleep(lead_s)
        happened_s = clock.now_s()
        EVENTS[trial.event](run, world)
        until_s = happened_s + GIVE_UP_S
        while clock.now_s() < until_s:
            heard = world.ask("arm_stops")
            first = _first_of_each_board(heard["stops"], happened_s)
            trial.power_off_s = _power_off(heard.get("supply", []), late_from_s)
            if len(first) == 2:
                trial.stop_s = round(max(first.values()) - happened_s, 3)
            # of a process that was stopped it is the motors' supply that counts
            if (trial.power_off_s if trial.fault == "sigstop" else trial.stop_s) is not None:
                break
            time.sleep(0.05)


def _first_of_each_board(stops: Sequence[dict[str, Any]], after_s: float) -> dict[int, float]:
    first: dict[int, float] = {}
    for stop in stops:
        if stop["at_s"] >= after_s:
            first.setdefault(stop["ip"], stop["at_s"])
    return first


def _power_off(supply: Sequence[dict[str, Any]], after_s: float) -> float | None:
    offs = [one["at_s"] for one in supply if not one["on"] and one["at_s"] >= after_s]
    return round(offs[0] - after_s, 3) if offs else None


def summed(trials: Sequence[Trial]) -> dict[str, float | int | bool]:
    """Return figures of the same fault; what never came counts as the longest wait."""
    is_power = trials[0].fault == "sigstop"
    values = [one.power_off_s if is_power else one.stop_s for one in trials]
    seconds = [GIVE_UP_S if s is None else s for s in values]
    p50, p99 = (round(float(np.percentile(seconds, q)), 3) for q in (50, 99))
    return {
        "trials": len(trials),
        "never": sum(s is None for s in values),
        "p50_s": p50,
        "p99_s": p99,
        "max_s": max(seconds),
        "asked_s": POWER_ASKED_S if is_power else STOP_ASKED_S,
        "is_met": p99 <= (POWER_ASKED_S if is_power else STOP_ASKED_S),
    }


def drawn(args: argparse.Namespace) -> list[tuple[str, str, str, int]]:
    """Return which trials are made, by the seed: each fault equally often, stages in turn."""
    rng = random.Random(args.seed)
    every = list(itertools.product(args.faults, args.stages, args.events))
    if args.all:
        chosen = every
    else:
        by_fault = [[one for one in every if one[0] == fault] for fault in args.faults]
        for group in by_fault:
            rng.shuffle(group)
        chosen = [one for turn in zip(*by_fault, strict=True) for one in turn][: args.trials]
    return [(*one, rng.randrange(2**31)) for one in chosen]


def main() -> int:
    parser = Arguments(
        __doc__, trials=1, faults=["gc"], stages=["moving"], events=["stop"], seed=13
    )
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--all", action="store_true", help="every combination once")
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS)[1:])
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=list(STAGES))
    parser.add_argument("--events", nargs="+", choices=EVENTS, default=list(EVENTS))
    parser.add_argument("--watchdog", type=float, default=1.0, metavar="SECONDS",
                        help="of the I/O block (ADR 98); 0: none")  # fmt: skip
    parser.add_argument("--lead", type=float, default=LEAD_S, metavar="SECONDS",
                        help="from the fault to the event")  # fmt: skip
    args = parser.parse_args()
    trials: list[Trial] = []
    for fault, stage, event, seed in drawn(args):
        trials.append(try_it(fault, stage, event, seed, args.watchdog, args.lead))
        note(asdict(trials[-1]))
    good = [one for one in trials if not one.problem]
    sums = {
        fault: summed(group)
        for fault in args.faults
        if (group := [one for one in good if one.fault == fault])
    }
    show(args, [asdict(one) for one in trials], sums)
    is_met = len(good) == len(trials) and all(one["is_met"] for one in sums.values())
    return 0 if is_met else 1


if __name__ == "__main__":
    sys.exit(main())
