"""Run the emulated cell as a process beside a command; only its addresses come back."""

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from controller.arrays import FloatArray
from controller.config import ConfigError
from messages import key, say

# Guards against a hang. The first use of a part takes minutes on a busy machine, because the part
# is decomposed into convex pieces.
READY_TIMEOUT_S = 900.0
STOP_TIMEOUT_S = 60.0
CANNOT_START = 2  # the emulator's exit code for a wrong option or file, or a library not installed


class EmulatorError(Exception):
    """The emulated cell did not start."""


def emulator_command(
    cell: Path, parts: Sequence[Path], *, speed: float, seed: int | None, more: Sequence[str] = ()
) -> list[str]:
    """Return the command line of the emulator, which is a separate program on purpose.

    Parameters
    ----------
    cell : cell file
    parts : CAD files of the parts on the table; none leaves it empty
    speed : speed of the emulated cell, times real time
    seed : seed of the emulated world, None for one of its own
    more : further options, as `emulator_args` returns them
    """
    command = [
        sys.executable,
        "-P",
        "-m",
        "emulators",
        "--cell",
        str(cell),
        "--speed",
        f"{speed:g}",
    ]
    for part in parts:
        command += ["--part", str(part)]
    if not parts:
        command.append("--empty")
    if seed is not None:
        command += ["--seed", str(seed)]
    return [*command, *more]


def emulator_args(
    orientation: FloatArray | None,
    at: str | None,
    control: Path | None,
    as_built: int | None = None,
    surfaces: str | None = None,
    *,
    is_on_wall_clock: bool = False,
    code: str = "",
) -> tuple[str, ...]:
    """Return the emulator's options for the first part's pose, for faults, and for the cell.

    Parameters
    ----------
    orientation : (3, 3) CAD -> upright, of the first part at rest; None to draw it by the seed. The
        emulator numbers stable poses in its own order, so it is given the rotation, not the index
    at : planar pose of the first part, "X,Y,THETA_DEG" [mm, degrees]; None to draw it by the seed
    control : unix socket on which tests inject faults, None for none
    as_built : seed of how the emulated cell differs from its file, None for not at all
    surfaces : surfaces of the parts in pictures, "plain" or "machined"; None: as `as_built` has it
    is_on_wall_clock : its time runs on while clients or pictures are late
    code : code on the first part, as ``KIND:TEXT``; empty for parts without one
    """
    more: list[str] = [] if as_built is None else ["--as-built", str(as_built)]
    if is_on_wall_clock:
        more += ["--wall-clock"]
    if surfaces is not None:
        more += ["--surfaces", surfaces]
    if orientation is not None:
        numbers = ",".join(f"{float(number):.9f}" for number in orientation.ravel())
        more += [f"--orientation={numbers}"]
    if at is not None:
        more += [f"--at={at}"]  # in one word, since the value may begin with a minus
    if code:
        more += [f"--code={code}"]
    if control is not None:
        more += ["--control", str(control)]
    return tuple(more)


@contextmanager
def emulated_cell(command: Sequence[str], log_path: Path | None = None) -> Iterator[dict[str, Any]]:
    """Start the emulator, yield the addresses that it prints, end it.

    Parameters
    ----------
    command : as `emulator_command` returns it
    log_path : path of its log, None to quote the last message in an error and drop the others

    Raises
    ------
    ConfigError : the emulator refuses an option or a file, or a library of its is missing
    EmulatorError : it did not become ready
    """
    if log_path is not None:
        log_path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile() if log_path is None else log_path.open("w+b") as log:
        # Its own session, so that Ctrl-C reaches only us: the emulated cell must live until the
        # arm has stopped.
        process = subprocess.Popen(
            [*command, "--die-with-parent"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            start_new_session=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        try:
            yield _ready(
                process, log, "" if log_path is None else say("; see {log_path}", log_path=log_path)
            )
        finally:
            _end(process)


def _ready(process: "subprocess.Popen[bytes]", log: IO[bytes], where: str) -> dict[str, Any]:
    lines: queue.Queue[bytes] = queue.Queue()
    stream = process.stdout
    assert stream is not None

    def pump() -> None:
        for line in stream:
            lines.put(line)
        lines.put(b"")

    threading.Thread(target=pump, daemon=True, name="emulator output").start()
    while True:
        try:
            line = lines.get(timeout=READY_TIMEOUT_S)
        except queue.Empty:
            raise EmulatorError(
                say(
                    "the emulated cell was not ready within {ready_timeout_s:.0f} s; "
                    "close what else runs on this machine and start again{where}",
                    ready_timeout_s=READY_TIMEOUT_S,
                    where=where,
                )
            ) from None
        if not line:
            code = process.wait()
            words = _last_words(log)
            if code == CANNOT_START:
                raise ConfigError(words.removeprefix("emulators.app: "))
            raise EmulatorError(
                say(
                    "the emulated cell ended with code {code}: {words}{where}",
                    code=code,
                    words=words,
                    where=where,
                )
            )
        try:
            body = json.loads(line)
        except ValueError:
            continue
        if isinstance(body, dict) and body.get("event") == "ready":
            return body


def _last_words(log: IO[bytes]) -> str:
    log.seek(0)
    lines = [line for line in log.read().decode(errors="replace").splitlines() if line.strip()]
    return lines[-1] if lines else key("no message")


def _end(process: "subprocess.Popen[bytes]") -> None:
    if process.stdin is not None:
        process.stdin.close()
    process.terminate()
    try:
        process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
