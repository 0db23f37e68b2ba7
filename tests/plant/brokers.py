"""A mosquitto broker of a test's own on loopback, which may be killed, and who listens to it.

Broker and listener are strangers: nobody here wrote them.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

PROGRAM = shutil.which("mosquitto") or (
    "/usr/sbin/mosquitto" if Path("/usr/sbin/mosquitto").exists() else None
)
PATIENCE_S = 60.0  # a guard against a hang on a busy machine, no measure


def missing() -> str:
    """Return why there is no broker to be had; empty if there is one."""
    if PROGRAM and shutil.which("mosquitto_sub"):
        return ""
    return "no mosquitto here (Debian: apt-get install mosquitto mosquitto-clients)"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class Broker:
    """A broker; `lines` are lines of its configuration beside the port."""

    folder: Path
    lines: Sequence[str] = ("allow_anonymous true",)
    port: int = field(default_factory=free_port)
    _process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait until it listens."""
        assert PROGRAM is not None
        file = self.folder / "mosquitto.conf"
        data = self.folder / "data"
        data.mkdir(exist_ok=True)
        more = ["persistence true", f"persistence_location {data}/", "autosave_interval 3600"]
        user = ["user root"] if os.getuid() == 0 else []
        text = [f"listener {self.port} 127.0.0.1", *self.lines, *more, *user]
        file.write_text("\n".join(text) + "\n")
        with (self.folder / "broker.log").open("ab") as log:
            self._process = subprocess.Popen([PROGRAM, "-v", "-c", file], stdout=log, stderr=log)
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            assert self._process.poll() is None, self.log
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.05)
        raise TimeoutError(self.log)

    def end(self, by: signal.Signals = signal.SIGKILL) -> None:
        """End it; SIGKILL by default."""
        if self._process is not None:
            self._process.send_signal(by)
            self._process.wait(PATIENCE_S)
            self._process = None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def save(self) -> None:
        """Have it write what it has confirmed: what it holds in memory alone dies with it."""
        assert self._process is not None
        file = self.folder / "data" / "mosquitto.db"
        before = file.stat().st_ino if file.exists() else 0
        self._process.send_signal(signal.SIGUSR1)
        end = time.monotonic() + PATIENCE_S
        while (
            not file.exists() or file.stat().st_ino == before
        ):  # it is written beside, and renamed
            assert time.monotonic() < end
            time.sleep(0.02)

    @property
    def log(self) -> str:
        return (self.folder / "broker.log").read_text(errors="replace")


@contextmanager
def broker(folder: Path, *lines: str) -> Iterator[Broker]:
    one = Broker(folder, lines or ("allow_anonymous true",))
    one.start()
    try:
        yield one
    finally:
        one.end()


class Listener:
    """`mosquitto_sub` with a persistent session, which comes back by itself; lines in a file."""

    def __init__(
        self, at: Broker, *topics: str, extra: Sequence[str] = (), form: str = "%t %p"
    ) -> None:
        # 3.1.1: mosquitto 2.0.11 forgets sessions of MQTT 5 when it is killed
        self._file = at.folder / f"heard-{'-'.join(topics).replace('/', '_')[:60]}.txt"
        wanted = [word for topic in topics for word in ("-t", topic)]
        self._output = self._file.open("ab")
        self._process = subprocess.Popen(
            [
                *("mosquitto_sub", "-h", "127.0.0.1", "-p", str(at.port), "-q", "1", "-F", form),
                *("-i", f"listener-{self._file.stem}", "-c", "-V", "311", *wanted),
                *extra,
            ],
            stdout=self._output,
        )

    @property
    def lines(self) -> list[str]:
        return self._file.read_text(errors="replace").splitlines()

    def end(self) -> None:
        self._process.kill()
        self._process.wait(PATIENCE_S)
        self._output.close()
