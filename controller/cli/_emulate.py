"""`cellctl emulate`: the emulated cell for any client."""

import signal
import threading
from pathlib import Path

from ._emulator import emulated_cell, emulator_command
from ._output import emit, say


def serve(
    cell: Path,
    parts: tuple[Path, ...],
    speed: float,
    seed: int | None,
    more: tuple[str, ...],
    *,
    as_json: bool,
) -> int:
    """Bring the emulated cell up, say where it is, keep it until Ctrl-C."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    command = emulator_command(cell, parts, speed=speed, seed=seed, more=more)
    with emulated_cell(command) as ready:
        if as_json:
            emit(ready)
        else:
            say(f"emulated cell ready, {ready['speed']:g} x real time, seed {ready['seed']}")
            for name, where in ready["devices"].items():
                text = (
                    where
                    if isinstance(where, str)
                    else " ".join(f"{k} {v}" for k, v in where.items())
                )
                say(f"  {name:11} {text}")
            say(f"  {'clock':11} {ready['clock']}")
            say("a cell file with all these addresses shares the clock by itself; Ctrl-C ends it")
        ended.wait()
    return 0
