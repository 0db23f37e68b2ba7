"""One controller at a time per cell: lock files held for the whole run.

One lock file lies beside the journal. Another one, for each gripper whose address the cell file
gives, lies in the user's folder for state: it keeps out a run with another folder of runs. The
locks are the kernel's (`flock`), so they end with their process, however that ends. The content of
a lock file is used only for the message.
"""

import fcntl
import json
import os
import pwd
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Final

from controller.config import EMULATED, Cell
from messages import key, say

from .errors import CellError
from .journal import JournalError

LOCK_NAME: Final = "cell.lock"


class CellBusyError(CellError):
    """Another controller has the cell: nothing was moved, nothing was written."""


@dataclass(frozen=True, slots=True)
class Holder:
    """The holder of a cell.

    Attributes
    ----------
    run : its name, or that of another command
    user : user of the process
    host : the computer it is on
    pid : its process
    since : time at which it took the lock, UTC
    control : its control socket; empty if it serves none
    """

    run: str
    user: str
    host: str
    pid: int
    since: str
    control: str = ""

    @classmethod
    def this_process(cls, run: str, control: str = "") -> "Holder":
        """Return this process as the holder, from now on.

        Parameters
        ----------
        run : its name
        control : its control socket
        """
        try:
            user = pwd.getpwuid(os.getuid()).pw_name
        except KeyError:  # a container may have no name for its user
            user = f"uid {os.getuid()}"
        now = datetime.now(UTC).isoformat(timespec="seconds")
        return cls(run, user, socket.gethostname(), os.getpid(), now, control)

    def __str__(self) -> str:
        return say(
            "run {run} of {user} (process {pid} on {host}, since {since})",
            run=self.run,
            user=self.user,
            pid=self.pid,
            host=self.host,
            since=self.since,
        )


def state_dir() -> Path:
    """Return the folder for files that outlive a run and its folder: $XDG_STATE_HOME/cellctl."""
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
def hold_cell(
    runs_dir: Path, cell: Cell, run_id: str, control: Path | None = None
) -> Iterator[Holder]:
    """Take a cell's locks and yield their holder, or raise an error that names the present one.

    Parameters
    ----------
    runs_dir : folder of the runs, which has one of the locks
    cell : its grippers' addresses name the other locks
    run_id : this run, named in the message to a run that is refused
    control : path of this run's control socket

    Raises
    ------
    CellBusyError : another process has the cell
    JournalError : a folder for locks cannot be written
    """
    with ExitStack() as held:
        holder = Holder.this_process(run_id, "" if control is None else str(control))
        for path in lock_paths(runs_dir, cell):
            held.enter_context(_hold(path, holder))
        yield holder


def read_holder(path: Path) -> Holder | None:
    """Return the holder of a lock file; None if there is none, or it has crashed.

    Parameters
    ----------
    path : the lock file; it need not exist
    """
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _holder(fd)
    finally:
        os.close(fd)
    return None


@contextmanager
def _hold(path: Path, holder: Holder) -> Iterator[None]:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Not inherited by child processes (PEP 446): the lock must not outlive this process.
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise JournalError(
            say(
                "lock {path}: {strerror}; nothing moves without it. Make its folder writable",
                path=path,
                strerror=error.strerror,
            )
        ) from error
    try:
        _lock(fd, fcntl.LOCK_EX, path)
        os.ftruncate(fd, 0)
        os.pwrite(fd, json.dumps(asdict(holder)).encode(), 0)
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
            say(
                "the cell is busy: {holder} has it. Nothing has moved. Wait until "
                "that run has ended, or stop it with `cellctl stop` (lock: {path})",
                holder=_holder(fd) or key("another process"),
                path=path,
            )
        ) from error


def _holder(fd: int) -> Holder | None:
    try:
        body = json.loads(os.pread(fd, 4096, 0))
        texts = {name: str(body[name]) for name in ("run", "user", "host", "since")}
        return Holder(pid=int(body["pid"]), control=str(body.get("control", "")), **texts)
    except (ValueError, KeyError, TypeError):
        return None  # it took the lock a moment ago and has not written its name yet
