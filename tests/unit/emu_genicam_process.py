"""Emulated GigE Vision cameras in a process of their own, as clients meet them."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator

from emu_camera_process import PATIENCE_S, ROOT, CameraProcess


@contextlib.contextmanager
def genicam_cameras(*options: str) -> Iterator[CameraProcess]:
    """Run cameras; fails if their process ends badly."""
    process = subprocess.Popen(
        [sys.executable, "-m", "emulators.camera_genicam", *options],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        with process:
            yield CameraProcess(process)
            assert process.stdin is not None
            process.stdin.close()
            assert process.wait(PATIENCE_S) == 0
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
