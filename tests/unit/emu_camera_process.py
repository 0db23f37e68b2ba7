"""Emulated cameras in a separate process, as in a cell: FUSE needs its client in another one."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from select import select
from typing import Any

ROOT = Path(__file__).parents[2]
PATIENCE_S = 600.0  # on a busy machine; what is waited for takes tenths of a second


class CameraProcess:
    """Test-pattern cameras, and the control port that tests have."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self.is_killed = False
        self.state: dict[str, Any] = self._hear()

    def __getitem__(self, name: str) -> str:
        """Return a camera's address."""
        return str(self.state["addresses"][name])

    @property
    def pid(self) -> int:
        return self._process.pid

    def tell(self, **order: object) -> None:
        """Give an order, e.g. `unplug="video0"`, and wait until it is obeyed."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        self.state = self._hear()

    def _hear(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        ready, _, _ = select([self._process.stdout], [], [], PATIENCE_S)
        line = self._process.stdout.readline() if ready else ""
        assert line, f"the cameras' process says nothing, exit code {self._process.poll()}"
        state: dict[str, Any] = json.loads(line)
        return state


def is_mounted(directory: Path) -> bool:
    mounts = Path("/proc/mounts").read_text().splitlines()
    return any(line.split()[1] == str(directory) for line in mounts)


@contextlib.contextmanager
def cameras(directory: Path, *options: str) -> Iterator[CameraProcess]:
    """Run cameras in a directory; fails if the process ends badly or leaves its mount behind.

    Whoever kills the process says so by `process.is_killed = True`.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "emulators.camera_v4l2", str(directory), *options],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        with process:
            running = CameraProcess(process)
            yield running
            assert process.stdin is not None
            process.stdin.close()
            exit_code = process.wait(PATIENCE_S)
            assert running.is_killed or (exit_code == 0 and not is_mounted(directory))
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        if is_mounted(directory):
            subprocess.run(["umount", "-l", directory], check=True, timeout=PATIENCE_S)
