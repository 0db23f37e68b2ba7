"""Every end is a stop: end a run in each way while the arm moves, and see what is left.

The emulated cell is a process of its own, so that the world tells what arm and jaws did afterwards.
Ways: the terminal is closed, SIGTERM, SIGHUP, Ctrl-Z, the reader of the output leaves, the parent
is killed, the worker process is killed, the emulated cell is killed. The part stays in the gripper,
so that the next start must be refused, too.
"""

import json
import os
import pty
import signal
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import dataclass
from fcntl import ioctl
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

from kill_world import ROOT, KillWorld, kill_world, let_go_count, lines_of, start

from controller.cell.journal import JOURNAL_NAME, read_rows

RECIPE, PART, SEED = "recipes/holder.yaml", "recipes/parts/holder.stl", 8
STAGE = "presenting"


@dataclass
class Run:
    """A run in a session of its own, under a terminal, its JSON on a pipe.

    Attributes
    ----------
    shell : what was started: the run itself, or the shell that has started it
    pid : of the run
    """

    shell: "Popen[str]"
    pid: int
    terminal: int

    def is_over(self) -> bool:
        """Return whether the run has ended."""
        return self.pid not in processes_of(self.shell.pid)


def processes_of(session: int) -> dict[int, str]:
    """Return the processes of a session that still live, with their command lines."""
    found = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                found[int(entry.name)] = (entry / "cmdline").read_text().replace("\0", " ")
        except OSError:
            continue  # it has just gone
    return found


def begin(world: KillWorld, runs: Path, *, by_a_shell: bool) -> Run:
    """Start a run and wait until the arm moves with the part."""
    master, slave = pty.openpty()
    command = [
        sys.executable, "-m", "controller.cli", "run", RECIPE, "--cell", str(world.cell),
        "--runs", str(runs), "--json",
    ]  # fmt: skip
    if by_a_shell:
        words = " ".join(command)
        command = ["/bin/sh", "-c", f"{words} & wait"]
    shell = Popen(
        command,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=slave,
        stdout=PIPE,
        stderr=slave,
        text=True,
        start_new_session=True,
        # a shell that has the terminal would pass its own death on as SIGHUP
        preexec_fn=_hear_hang_ups if by_a_shell else _take_terminal,
    )
    os.close(slave)
    assert shell.stdout is not None
    for line in shell.stdout:
        if json.loads(line).get("state") == STAGE:
            break
    else:
        raise RuntimeError("the run ended before it had the part")
    runs_of_session = [
        pid
        for pid, text in processes_of(shell.pid).items()
        if "controller.cli run" in text and "/bin/sh" not in text
    ]
    world.until_moving()
    return Run(shell, min(runs_of_session), master)


def _hear_hang_ups() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where this bench runs under nohup


def _take_terminal() -> None:
    _hear_hang_ups()
    ioctl(0, termios.TIOCSCTTY, 0)


def worker_of(run: Run) -> int:
    """Return the worker process of a run."""
    (pid,) = [p for p, text in processes_of(run.shell.pid).items() if "spawn_main" in text]
    return pid


def close_output(run: Run, world: KillWorld) -> None:
    assert run.shell.stdout is not None
    run.shell.stdout.close()


@dataclass(frozen=True)
class Way:
    """How a run is ended, and what its journal must say of that."""

    act: Callable[[Run, KillWorld], object]
    code: str
    by_a_shell: bool = False


WAYS = {
    "terminal": Way(lambda run, world: os.close(run.terminal), "terminal_gone"),
    "hang up": Way(lambda run, world: os.kill(run.pid, signal.SIGHUP), "terminal_gone"),
    "terminate": Way(lambda run, world: os.kill(run.pid, signal.SIGTERM), "stop"),
    "ctrl-z": Way(lambda run, world: os.write(run.terminal, b"\x1a"), "stop"),
    "ctrl-c": Way(lambda run, world: os.write(run.terminal, b"\x03"), "stop"),
    "output": Way(close_output, "output_gone"),
    "parent": Way(
        lambda run, world: os.kill(run.shell.pid, signal.SIGKILL), "parent_gone", by_a_shell=True
    ),
    "worker": Way(lambda run, world: os.kill(worker_of(run), signal.SIGKILL), "worker_gone"),
    "emulator": Way(lambda run, world: os.kill(world.pid, signal.SIGKILL), ""),
}


def end_by(name: str, speed: float, folder: Path) -> dict[str, Any]:
    """End a run in one way and return what it left."""
    way, runs = WAYS[name], folder / "runs"
    with kill_world(folder, PART, seed=SEED, speed=speed) as world:
        run = begin(world, runs, by_a_shell=way.by_a_shell)
        before, begun = world.truth(), time.monotonic()
        way.act(run, world)
        if name != "output":
            assert run.shell.stdout is not None
            run.shell.stdout.read()
        while processes_of(run.shell.pid) and time.monotonic() - begun < 120:
            run.shell.poll()
            time.sleep(0.05)
        took_s = time.monotonic() - begun
        left = processes_of(run.shell.pid)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        run.shell.wait()
        if name != "terminal":
            os.close(run.terminal)
        if run.shell.stdout is not None:
            run.shell.stdout.close()
        after, following = None, None
        rows = list(read_rows(runs / JOURNAL_NAME))
        if name != "emulator":
            after = world.when_still()
            following = the_next_start(world, runs)
    at_rest = [row.body for row in rows if row.name == "at_rest"]
    outcome: dict[str, Any] = {
        "way": name,
        "end": at_rest[-1]["state"] if at_rest else None,
        "code": at_rest[-1]["code"] if at_rest else None,
        "message": at_rest[-1]["message"] if at_rest else None,
        # what was kept of the run is hashed last of all
        "last_row": [r.name for r in rows if r.name != "files_stored"][-1],
        "report": any(runs.glob("*/report.html")),
        "left_behind": list(left.values()),
        "took_wall_s": round(took_s, 1),
    }
    if after is not None:
        outcome |= {
            "held_by": after["parts"][0]["custody"],
            "let_go": let_go_count(after) - let_go_count(before),
            "arm_went_on_s": round(after["last_motion_s"]["arm"] - before["time_s"], 2),
            "next_start": following,
        }
    outcome["ok"] = (
        (outcome["end"], outcome["last_row"])
        in (("stopped", "run_ended"), ("aborted", "run_ended"))
        and way.code in ("", outcome["code"])
        and outcome["report"]
        and not left
        and (after is None or (outcome["held_by"] == "arm" and outcome["let_go"] == 0))
        and following in (None, "refused, nothing moved")
    )
    return outcome


def the_next_start(world: KillWorld, runs: Path) -> str:
    """Start again on what was left; return how that ended and whether anything moved."""
    before = world.truth()
    again = start(world, RECIPE, runs)
    with again:
        *_, result = lines_of(again)
    after = world.when_still()
    has_moved = before["last_motion_s"] != after["last_motion_s"] or let_go_count(
        before
    ) != let_go_count(after)
    return f"{result.get('end')}, {'something' if has_moved else 'nothing'} moved"
