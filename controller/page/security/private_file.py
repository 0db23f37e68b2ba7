"""Files of this user alone: read only where nobody else may read or change them, written whole."""

import os
import stat
from pathlib import Path
from typing import Final

MAX_BYTES: Final = 1_000_000


class SharedFileError(Exception):
    """Others may read or change the file."""


def read_private(path: Path) -> bytes | None:
    """Return the first `MAX_BYTES` of a file of this user; None where there is none.

    Raises
    ------
    SharedFileError : others may read or change it
    OSError : it cannot be read
    """
    try:
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
                raise SharedFileError(f"{path}: others may read or change it; chmod 600 {path}")
            return file.read(MAX_BYTES)
    except FileNotFoundError:
        return None


def read_secret(path: Path) -> bytes:
    """Return the content of a file of this user without blanks around it.

    Raises
    ------
    OSError : it is not there, cannot be read, others may read or change it, or it is empty
    """
    try:
        found = read_private(path)
    except SharedFileError as error:
        raise OSError(str(error)) from error
    if found is None:
        raise OSError(f"{path}: there is no such file")
    if not found.strip():
        raise OSError(f"{path}: it is empty")
    return found.strip()


def write_private(path: Path, text: str) -> None:
    """Write a file that only this user may read, whole or not at all.

    Raises
    ------
    OSError : it cannot be written
    """
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as to:
        to.write(text)
    fresh.replace(path)
