"""Output that nobody reads holds nothing up: live lines are left out and counted."""

from __future__ import annotations

import json
import logging
import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from controller.cell.services.records import RunProgress
from controller.cli.running.run_output import display
from controller.cli.terminal.output import emit, log_stream, lost_line_count, relayed, stderr, warn

LINES = 5000  # of 400 bytes: a pipe takes 65 kB
LONG_S = 600.0

# a run in small: it says what it does without end, and stops when it is asked to
RUN = """
import asyncio, os, sys
from controller.cli.running.ends import CommandEnds
from controller.cli.terminal.output import emit, warn

class Work:
    def __init__(self):
        self.stopped = asyncio.Event()
    def request_stop(self, message, code):
        os.write(int(sys.argv[1]), b"stop bytes")
        self.stopped.set()
    request_abort = request_stop

async def run(ends):
    work, number = Work(), 0
    with ends.stopping(work, None):
        while not work.stopped.is_set():
            emit({"number": number, "filler": "x" * 400}, is_live=True)
            warn("x" * 400)
            number += 1
            if number == 1000:
                os.write(int(sys.argv[1]), b"moving")
            await asyncio.sleep(0)

with CommandEnds().heard() as ends:
    asyncio.run(run(ends))
"""


class Reader:
    """The other end of a standard stream; reads once it is told to."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._data = b""
        self._thread = threading.Thread(target=self._read, daemon=True)

    def begin(self) -> None:
        self._thread.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._fd, 65536)
            except OSError:  # a pseudo-terminal whose other end was closed
                return
            if not data:
                return
            self._data += data

    def join(self) -> None:
        if self._thread.ident is not None:
            self._thread.join(LONG_S)

    def lines(self) -> list[str]:
        self.join()
        return self._data.decode().splitlines()


@contextmanager
def unread() -> Iterator[Reader]:
    """Put a pipe in the place of stdout while the block runs; nobody reads it yet."""
    far, near = os.pipe()
    try:
        # not in a fixture: pytest captures anew for each phase of a test
        with os.fdopen(near, "w", encoding="utf-8") as stream, redirect_stdout(stream):
            yield (reader := Reader(far))
        reader.join()
    finally:
        os.close(far)


def test_a_slow_reader_gets_the_result_and_the_count_of_what_it_lost() -> None:
    with unread() as reader, relayed():
        for number in range(LINES):
            emit({"event": "progress", "number": number, "filler": "x" * 400}, is_live=True)
        lost = lost_line_count()
        emit({"event": "result", "lost_lines": lost})
        reader.begin()
    *live, result = [json.loads(line) for line in reader.lines()]
    assert result == {"event": "result", "lost_lines": lost}
    assert lost > 0
    assert len(live) == LINES - lost
    numbers = [one["number"] for one in live]
    assert numbers == sorted(numbers)


def test_a_reader_that_never_reads_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("controller.cli.terminal.relay.STALL_WALL_S", 0.05)
    with unread():
        with relayed():
            for number in range(LINES):
                emit({"number": number, "filler": "x" * 400}, is_live=True)
        emit({"event": "after"})  # goes nowhere, and does not block either


def test_a_terminal_after_ctrl_s_holds_up_neither_table_nor_sentences_nor_logs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    far, near = pty.openpty()
    with os.fdopen(near, "w", encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        monkeypatch.setattr(stderr, "_force_terminal", True)
        termios.tcflow(near, termios.TCOOFF)  # what Ctrl-S does
        handler = logging.StreamHandler(log_stream)
        reader = Reader(far)
        with relayed():
            with display(as_json=False) as show:
                for number in range(300):
                    show(RunProgress(state=f"state {number}"))
                    warn(f"sentence {number} {'x' * 400}")
                    handler.emit(logging.LogRecord("a", 40, "", 0, f"log {number}", None, None))
            termios.tcflow(near, termios.TCOON)  # Ctrl-Q
            reader.begin()
    text = "\n".join(reader.lines())
    os.close(far)
    assert [int(n) for n in re.findall(r"sentence (\d+)", text)] == list(range(300))
    assert [int(n) for n in re.findall(r"log (\d+)", text)] == list(range(300))


def started(where: Any, signals_fd: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", RUN, str(signals_fd)],
        stdout=where,
        stderr=where,
        stdin=subprocess.DEVNULL,
        pass_fds=(signals_fd,),
        cwd=Path(__file__).parents[2],
        start_new_session=True,
    )


def told_by(fd: int) -> bytes:
    # a program that fails here blocks, too: nobody reads its traceback
    ready, _, _ = select.select([fd], [], [], LONG_S)
    return os.read(fd, 100) if ready else b""


@pytest.mark.parametrize(
    ("kind", "number"), [("pipe", signal.SIGTERM), ("terminal", signal.SIGINT)]
)
def test_a_signal_stops_a_run_whose_output_is_blocked(kind: str, number: signal.Signals) -> None:
    far, near = os.pipe() if kind == "pipe" else pty.openpty()
    if kind == "terminal":
        termios.tcflow(near, termios.TCOOFF)
    heard, told = os.pipe()
    process = started(near, told)
    os.close(told)
    try:
        assert told_by(heard) == b"moving"
        process.send_signal(number)
        assert told_by(heard) == b"stop bytes"
        assert process.wait(LONG_S) == 0
    finally:
        process.kill()
        process.wait()
        for fd in (far, near, heard):
            os.close(fd)
