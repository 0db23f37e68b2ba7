"""The journal's head: number and hash of the last row known to be on the disk, in a file beside it.

The chain of hashes reveals a changed row and a row missing in the middle, but not a row cut off the
end; the head reveals that. It is written after the rows up to the one it names are on the disk, so
that an untouched journal never ends before its head, even after a power failure.
"""

import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from messages import say

LENGTH: Final = 128  # one short line of fixed length, so that it is written in one piece
SUFFIX: Final = ".head"


@dataclass(frozen=True, slots=True)
class Head:
    """The last row that is certainly on the disk."""

    seq: int
    hash: str


class HeadError(ValueError):
    """There is a head, but it cannot be read."""


def head_path(journal: Path) -> Path:
    """Return the path of a journal's head."""
    return journal.with_name(journal.name + SUFFIX)


def read_head(journal: Path) -> Head | None:
    """Return a journal's head; None if there is none.

    Raises
    ------
    HeadError : the file is not a head
    OSError : the file cannot be read
    """
    return read_head_file(head_path(journal))


def read_head_file(path: Path) -> Head | None:
    """Return the head that a file holds; None if there is no file.

    Raises
    ------
    HeadError : the file is not a head
    OSError : the file cannot be read
    """
    try:
        with path.open("rb") as file:
            text = file.read(LENGTH + 1)
    except FileNotFoundError:
        return None
    try:
        body = json.loads(text)
        head = Head(body["seq"], body["hash"])
    except (ValueError, KeyError, TypeError) as error:
        raise HeadError(say("{path} is no head of a journal", path=path)) from error
    if type(head.seq) is not int or type(head.hash) is not str:
        raise HeadError(say("{path} is no head of a journal", path=path))
    return head


class HeadFile:
    """Writer of one head of a journal; the file is made with the first row and kept open.

    Parameters
    ----------
    path : path of the file
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._fd: int | None = None

    def write(self, head: Head) -> None:
        """Put the head on the disk."""
        body = {"seq": head.seq, "hash": head.hash}
        line = json.dumps(body, separators=(",", ":")).ljust(LENGTH - 1).encode() + b"\n"
        if self._fd is None:
            self._fd = self._open(line)
        os.pwrite(self._fd, line, 0)
        os.fdatasync(self._fd)

    def _open(self, line: bytes) -> int:
        with suppress(FileNotFoundError):
            return os.open(self._path, os.O_WRONLY | os.O_CLOEXEC)
        # renamed into place, so that a new head appears whole or not at all
        new = self._path.with_name(f"{self._path.name}.{os.getpid()}")
        new.write_bytes(line)
        new.replace(self._path)
        return os.open(self._path, os.O_WRONLY | os.O_CLOEXEC)

    def close(self) -> None:
        """Close the file."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
