"""An emulator's files on the machine: its owner's alone, and removed with the emulator.

Its folder is locked for as long as the process lives, however it ends. Files of a killed one are
removed by its picture process once that is hung up on, or else by the next emulator that starts.
"""

import contextlib
import fcntl
import logging
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

log = logging.getLogger(__name__)

FOLDER_PREFIX: Final = "cellctl-cell-"
_LOCK: Final = ".alive"


def bind_owned(listener: socket.socket, path: Path) -> None:
    """Bind a unix socket that only its owner may open, from the first instant on.

    Raises
    ------
    OSError : the path is taken, too long, or in no folder
    """
    before = os.umask(0o177)
    try:
        listener.bind(str(path))
    finally:
        os.umask(before)


@contextlib.contextmanager
def owned_folder(unmount: Callable[[Path], None]) -> Iterator[Path]:
    """Yield a folder that is removed after the block; first remove those of killed emulators.

    Parameters
    ----------
    unmount : takes away what may be mounted on a folder; nothing there is fine
    """
    base = Path(tempfile.gettempdir())
    sweep(unmount)
    folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX, dir=base))  # mode 0700
    lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def sweep(unmount: Callable[[Path], None]) -> None:
    """Remove the folders of killed emulators.

    Parameters
    ----------
    unmount : takes away what may be mounted on a folder; nothing there is fine
    """
    for folder in Path(tempfile.gettempdir()).glob(f"{FOLDER_PREFIX}*"):
        try:
            found = folder.lstat()
            if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
                continue
            lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:
            continue  # it begins or ends just now
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for inside in folder.iterdir():
                if inside.name != _LOCK:
                    unmount(inside)
            shutil.rmtree(folder)
            log.info("took away %s, whose emulator was killed", folder)
        except BlockingIOError:
            pass  # it lives
        except OSError as error:
            log.warning("%s was left by an emulator that was killed: %s", folder, error)
        finally:
            os.close(lock)
