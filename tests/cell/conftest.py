"""A `cellctl run` of its own per test, on an emulated cell, with a hand on the control port.

The run knows nothing of the control port; the test uses it to cause faults and to ask the world
what really happened.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SPEED = 10.0
LIMIT_S = 1500.0  # a guard against a hang, no measure: a busy machine takes its time


class Control:
    """The world's control port."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, do: str, **order: Any) -> dict[str, Any]:
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(600)
            line.connect(str(self._path))
            with line.makefile("rwb") as file:
                file.write(json.dumps({"do": do, **order}).encode() + b"\n")
                file.flush()
                answer = json.loads(file.readline())
        assert answer.pop("ok"), answer
        return answer  # type: ignore[no-any-return]


@dataclass
class Ran:
    """How a run went."""

    code: int
    result: dict[str, Any]
    progress: list[dict[str, Any]]
    stderr: str
    runs: Path
    seen: dict[str, Any] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        return self.runs / str(self.result["run"])

    @property
    def journal(self) -> Path:
        return self.runs / "journal.sqlite"


Watcher = Callable[[dict[str, Any], "Run"], None]


class Run:
    """A `cellctl run --json` under way."""

    def __init__(self, recipe: str, *more: str, runs: Path, scratch: Path) -> None:
        self.runs = runs
        control = scratch / "control.sock"
        self.control = Control(control)
        self.seen: dict[str, Any] = {}
        command = [
            sys.executable, "-m", "controller.cli", "run", recipe, "--json",
            "--speed", f"{SPEED:g}", "--runs", str(runs), "--control", str(control), *more,
        ]  # fmt: skip
        self.process = subprocess.Popen(
            command,
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._stderr: list[str] = []
        self._reader = threading.Thread(target=self._drain, daemon=True)
        self._reader.start()
        self._timer = threading.Timer(LIMIT_S, self.kill)
        self._timer.start()

    def _drain(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._stderr.append(line)

    def interrupt(self) -> None:
        self.process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)

    def close(self) -> None:
        """End what is left of it and close its pipes, also after a test that broke off."""
        self.kill()
        self.process.wait()
        self._timer.cancel()
        self._reader.join()
        for pipe in (self.process.stdout, self.process.stderr):
            assert pipe is not None
            pipe.close()

    def follow(self, watcher: Watcher | None = None) -> Ran:
        """Read progress to the end; ``watcher`` sees each line as it comes."""
        progress: list[dict[str, Any]] = []
        result: dict[str, Any] = {}
        assert self.process.stdout is not None
        for line in self.process.stdout:
            body = json.loads(line)
            if body["event"] == "result":
                result = body
            else:
                progress.append(body)
            if watcher is not None:
                watcher(body, self)
        code = self.process.wait()
        self.close()
        return Ran(code, result, progress, "".join(self._stderr), self.runs, self.seen)


def once_in(state: str, act: Callable[[Run], None]) -> Watcher:
    """Return a watcher that acts when the run first reports a state."""
    done: list[bool] = []

    def watch(body: dict[str, Any], run: Run) -> None:
        if not done and body.get("state") == state:
            done.append(True)
            act(run)

    return watch


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Run]]:
    """Start a run in a folder of its own; whatever is left of it is ended."""
    begun: list[Run] = []

    def start_one(recipe: str, *more: str) -> Run:
        run = Run(recipe, *more, runs=tmp_path / "runs", scratch=tmp_path)
        begun.append(run)
        return run

    yield start_one
    for run in begun:
        run.close()
