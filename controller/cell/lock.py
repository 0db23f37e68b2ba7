"""One controller at a time per cell: a lock file beside the journal, held for the whole run.

The lock is the kernel's (`flock`), so that it goes with its process, however that ends. What the
file says serves the message alone.
"""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from .errors import CellError
from .journal import JournalError

LOCK_NAME: Final = "cell.lock"


class CellBusyError(CellError):
    """Another controller has the cell: nothing was moved, nothing was written."""


def require_free_cell(runs_dir: Path) -> None:
    """Raise CellBusyError where another controller has the cell: said at once, before any work."""
    path = runs_dir / LOCK_NAME
    if not path.exists():
        return
    fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        _lock(fd, fcntl.LOCK_SH, path)
    finally:
        os.close(fd)


@contextmanager
def hold_cell(runs_dir: Path, run_id: str) -> Iterator[None]:
    """Hold the cell whose journal stands in a folder, or refuse and name who holds it.

    Raises
    ------
    CellBusyError : another process has it
    JournalError : the folder cannot be written
    """
    path = runs_dir / LOCK_NAME
    try:
        runs_dir.mkdir(parents=True, exist_ok=True)
        # not inherited by children (PEP 446): it must not outlive this process in one of them
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise JournalError(
            f"folder of runs {runs_dir}: {error}; nothing moves without it"
        ) from error
    try:
        _lock(fd, fcntl.LOCK_EX, path)
        now = datetime.now(UTC).isoformat(timespec="seconds")
        text = json.dumps({"run": run_id, "pid": os.getpid(), "since": now})
        os.ftruncate(fd, 0)
        os.pwrite(fd, text.encode(), 0)
        try:
            yield
        finally:
            os.ftruncate(fd, 0)
    finally:
        os.close(fd)


def _lock(fd: int, how: int, path: Path) -> None:
    try:
        fcntl.flock(fd, how | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise CellBusyError(
            f"the cell is busy: {_holder(fd)} has it. Nothing has moved. Wait until that run has "
            f"ended, or stop it with Ctrl-C (lock: {path})"
        ) from error


def _holder(fd: int) -> str:
    try:
        body = json.loads(os.pread(fd, 4096, 0))
        return f"run {body['run']} (process {body['pid']}, since {body['since']})"
    except (ValueError, KeyError, TypeError):
        return "another process"  # it has only just taken it
