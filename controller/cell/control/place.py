"""The place of a cell's control socket: found from its lock, in a folder of this user alone."""

import os
import stat
import tempfile
from hashlib import sha256
from pathlib import Path

from messages import say

from ..errors import CellError
from ..lock import LOCK_NAME


class ControlError(CellError):
    """The control socket cannot be served, or its server has ended."""


def control_folder() -> Path:
    """Return the folder of this user's control sockets; it need not exist."""
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(runtime) / "cellctl"
    return Path(tempfile.gettempdir()) / f"cellctl-{os.getuid()}"


def socket_path(runs_dir: Path) -> Path:
    """Return the control socket of the cell whose lock stands in this folder of runs."""
    lock = str(runs_dir.resolve() / LOCK_NAME)
    # 108 bytes are the most that a socket's path may have, so that the name is short
    return control_folder() / f"{sha256(lock.encode()).hexdigest()[:16]}.sock"


def make_folder() -> Path:
    """Return the folder of control sockets, made for this user alone.

    Raises
    ------
    ControlError : somebody else owns it, others may enter it, or it cannot be made
    """
    folder = control_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise ControlError(
            say(
                "{folder}: {strerror}; the control socket is created there",
                folder=folder,
                strerror=error.strerror,
            )
        ) from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
        raise ControlError(
            say(
                "{folder}: belongs to another user; remove it, because the control "
                "socket needs this folder",
                folder=folder,
            )
        )
    if found.st_mode & 0o077:
        raise ControlError(say("{folder}: others may enter it; chmod 700 {folder}", folder=folder))
    return folder
