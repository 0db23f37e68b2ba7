"""One controller at a time per cell: lock files held for the whole run.

One lock file lies beside the journal. Another one, for each gripper whose address the cell file
gives, lies in the user's folder for state: it keeps out a run with another folder of runs. The
locks are the kernel's (`flock`), so they end with their process, however that ends. The content of
a lock file is used only for the message.
"""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Final

from controller.config import EMULATED, Cell

from ..errors import CellError
from ..journal import JournalError

LOCK_NAME: Final = "cell.lock"


class CellBusyError(CellError):
    """Another controller has the cell: nothing was moved, nothing was written."""


def state_dir() -> Path:
    """Return the folder for what outlasts a run and its folder: $XDG_STATE_HOME/cellctl."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(base) / "cellctl"


def lock_paths(runs_dir: Path, cell: Cell) -> tuple[Path, ...]:
    """Return the lock files that a process must hold to own a cell, in the order of locking."""
    folder = state_dir() / "locks"
    addresses = {
        f"{name} {getattr(cell.devices, name).address}"
        for name in ("arm", "gripper")
        if getattr(cell.devices, name).address != EMULATED
    }
    names = sorted(sha256(address.encode()).hexdigest()[:24] for address in addresses)
    return (runs_dir / LOCK_NAME, *(folder / f"{name}.lock" for name in names))


def require_free_cell(runs_dir: Path, cell: Cell) -> None:
    """Raise CellBusyError if another controller has the cell, at once and before any work."""
    for path in lock_paths(runs_dir, cell):
        if path.exists():
            fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            try:
                _lock(fd, fcntl.LOCK_SH, path)
            finally:
                os.close(fd)


@contextmanager
def hold_cell(runs_dir: Path, cell: Cell, run_id: str) -> Iterator[None]:
    """Hold a cell's locks, or raise an error that names who has them.

    Parameters
    ----------
    runs_dir : folder of the runs, which has one of the locks
    cell : its grippers' addresses name the other locks
    run_id : this run, named in the message to a run that is refused

    Raises
    ------
    CellBusyError : another process has the cell
    JournalError : a folder for locks cannot be written
    """
    with ExitStack() as held:
        for path in lock_paths(runs_dir, cell):
            held.enter_context(_hold(path, run_id))
        yield


@contextmanager
def _hold(path: Path, run_id: str) -> Iterator[None]:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Not inherited by child processes (PEP 446): the lock must not outlive this process.
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise JournalError(
            f"lock {path}: {error.strerror}; nothing moves without it. Make its folder writable"
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
        return "another process"  # it took the lock a moment ago and has not written its name yet
