"""An emulated cell that outlives its controllers, and what it says of jaws, arm and part."""

import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench import EMULATED, ROOT

STILL_S = 2.0  # of the world without any motion
# which events of the world let a part go
LET_GO = ("released", "lost")


def ask(control: Path, do: str, **order: object) -> dict[str, Any]:
    """Send one order to a control port and return the answer."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(60)
        line.connect(str(control))
        with line.makefile("rwb") as file:
            file.write(json.dumps({"do": do, **order}).encode() + b"\n")
            file.flush()
            return dict(json.loads(file.readline()))


@dataclass(frozen=True)
class KillWorld:
    """One emulated cell as a process of its own.

    Attributes
    ----------
    cell : cell file with its addresses
    clock : of its time
    pid : of the emulator's process
    """

    cell: Path
    control: Path
    clock: Path
    pid: int

    def ask(self, do: str, **order: object) -> dict[str, Any]:
        """Return the answer of the control port."""
        answer = ask(self.control, do, **order)
        assert answer.pop("ok"), answer
        return answer

    def truth(self) -> dict[str, Any]:
        """Return what is so in the world."""
        return self.ask("truth")

    def when_still(self) -> dict[str, Any]:
        """Return the truth once neither arm nor jaws have moved for a while."""
        while True:
            truth = self.truth()
            if truth["time_s"] - max(truth["last_motion_s"].values()) > STILL_S:
                return truth
            time.sleep(0.05)

    def until_moving(self) -> None:
        """Wait until the arm or a jaw moves."""
        begun = self.truth()["last_motion_s"]
        while self.truth()["last_motion_s"] == begun:
            time.sleep(0.002)


def let_go_count(truth: dict[str, Any]) -> int:
    """Return how often the part was let go while nobody else held it."""
    return sum(e["what"] in LET_GO and not e["is_held"] for e in truth["events"])


@contextmanager
def kill_world(
    folder: Path,
    *parts: str,
    seed: int,
    speed: float,
    more: Sequence[str] = (),
    io_settings: str = "",
    drawing: Path = EMULATED,
) -> Iterator[KillWorld]:
    """Bring up an emulated cell by itself, with a cell file that names its addresses."""
    control, drawn = folder / "control.sock", folder / "drawn.yaml"
    text = drawing.read_text()
    if io_settings:
        head, _, rest = text.partition("\n  io:")
        text = f"{head}\n  io:{rest.replace('}', f', settings: {io_settings}}}', 1)}"
    drawn.write_text(text)
    process = subprocess.Popen(
        [
            sys.executable, "-m", "controller.cli", "emulate", "--json", "--cell", str(drawn),
            *(word for part in parts for word in ("--part", part)),
            "--seed", str(seed), "--speed", f"{speed:g}", "--control", str(control),
            *more,
        ],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        ready = json.loads(process.stdout.readline())
        cell = folder / "cell.yaml"
        cell.write_text(with_addresses(text, ready["devices"]))
        yield KillWorld(cell, control, Path(ready["clock"]), int(ready["pid"]))
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


def with_addresses(text: str, devices: dict[str, Any]) -> str:
    """Return an emulated cell's file with the addresses of an emulator that is up."""
    for name, where in devices.items():
        address = where if isinstance(where, str) else f"{where['host']}:{where['port']}"
        text, count = re.subn(
            rf"(\n  {name}:\s+\{{[^}}]*?address: )emulated", rf"\g<1>{address}", text, count=1
        )
        assert count == 1, name
    return text


def start(world: KillWorld, recipe: str, runs: Path, *more: str) -> "subprocess.Popen[str]":
    """Start `cellctl run` on the world; its progress comes as JSON lines."""
    return subprocess.Popen(
        [
            sys.executable, "-m", "controller.cli", "run", recipe, "--cell", str(world.cell),
            "--runs", str(runs), "--json", *more,
        ],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def lines_of(process: "subprocess.Popen[str]") -> Iterator[dict[str, Any]]:
    """Yield what a run prints."""
    assert process.stdout is not None
    for line in process.stdout:
        yield json.loads(line)
