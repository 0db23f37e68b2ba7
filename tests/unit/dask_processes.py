"""A Dask cluster of processes on loopback, which are killed while a command works on it."""

from __future__ import annotations

import os
import re
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

MAX_WALL_S = 1200.0  # a guard against a hang, no measure


@dataclass(frozen=True)
class Killed:
    """How a command went whose cluster was killed, and how it went when it was started again."""

    first_code: int
    first_error: str
    second_code: int
    second_error: str

    @property
    def workers(self) -> set[str]:
        return set(re.findall(r"workers: \d of \d", self.first_error))


class Processes:
    """The scheduler and its workers."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> None:
        words = ["--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard", "--no-show"]
        self.scheduler = _start("distributed.cli.dask_scheduler", *words)
        wait_until(self._answers)

    def start_worker(self) -> None:
        words = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
        self.workers.append(_start("distributed.cli.dask_worker", self.address, *words))

    def kill_worker(self) -> None:
        worker = self.workers.pop(0)
        worker.kill()
        worker.wait()

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()

    def _answers(self) -> bool:
        with socket.socket() as asked:
            return asked.connect_ex(("127.0.0.1", self.port)) == 0


def _start(module: str, *words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", module, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def wait_until(is_so: Callable[[], bool]) -> None:
    """Wait until something is so; fail where it takes for ever."""
    end_s = time.monotonic() + MAX_WALL_S
    while not is_so():
        if time.monotonic() > end_s:
            raise TimeoutError("a process on loopback does not do what is waited for")
        time.sleep(0.05)


@contextmanager
def cluster(worker_count: int) -> Iterator[Processes]:
    """Yield a cluster with workers; at the end no process of it is left."""
    found = Processes()
    try:
        found.start_scheduler()
        for _ in range(worker_count):
            found.start_worker()
        yield found
    finally:
        for process in (*found.workers, *([found.scheduler] if found.scheduler else [])):
            process.kill()
            process.wait()


def rejudge_with_kills(words: Sequence[str], store: Path, kills: Sequence[int]) -> Killed:
    """Run `cellctl rejudge` on two workers that are killed, and again after the scheduler was.

    Parameters
    ----------
    words : the command, but for ``--jobs``
    store : file of its store
    kills : numbers of parts judged at which a worker is killed, another started in its place; at
        the last one the scheduler is killed
    """
    with cluster(2) as dask, TemporaryFile("w+", encoding="utf-8") as said:
        command = [sys.executable, "-m", "controller.cli", *words, "--jobs", dask.address]
        first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)

        def heard() -> str:
            return os.pread(said.fileno(), 1 << 20, 0).decode()

        try:
            for count, number in enumerate(kills[:-1], start=1):
                wait_until(lambda n=number: _judged(store) >= n or first.poll() is not None)
                dask.kill_worker()
                # the command has seen it go before another comes
                wait_until(
                    lambda n=count: (
                        heard().count("workers: 1 of 2") >= n or first.poll() is not None
                    )
                )
                dask.start_worker()
            wait_until(lambda: _judged(store) >= kills[-1] or first.poll() is not None)
            dask.kill_scheduler()
            first.wait(timeout=MAX_WALL_S)
            first_error = heard()
        finally:
            first.kill()
        while dask.workers:
            dask.kill_worker()
        dask.start_scheduler()
        dask.start_worker()
        dask.start_worker()
        second = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=MAX_WALL_S
        )
        return Killed(first.returncode, first_error, second.returncode, second.stderr)


def _judged(store: Path) -> int:
    """Return how many parts the store has anew; 0 while it is being made."""
    try:
        db = sqlite3.connect(f"{store.absolute().as_uri()}?mode=ro", uri=True)
        try:
            return int(db.execute("SELECT count(*) FROM rejudged").fetchone()[0])
        finally:
            db.close()
    except sqlite3.Error:
        return 0
