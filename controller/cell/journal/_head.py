"""The journal's head: number and hash of the last row known to be on the disk, in a file beside it.

A chain of hashes shows a changed row and one missing in the middle, not one cut off the end. The
head does. It is written after the rows it speaks of are synchronised, so that it is never ahead of
an honest journal, whatever the power does.
"""

import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

LENGTH: Final = 128  # one short line, always of one length: written in one piece
SUFFIX: Final = ".head"


@dataclass(frozen=True, slots=True)
class Head:
    """The last row that is surely on the disk."""

    seq: int
    hash: str


class HeadError(ValueError):
    """There is a head, and it cannot be read."""


def head_path(journal: Path) -> Path:
    """Return where a journal's head stands."""
    return journal.with_name(journal.name + SUFFIX)


def read_head(journal: Path) -> Head | None:
    """Return a journal's head; None where there is none.

    Raises
    ------
    HeadError : it is no head
    OSError : the file cannot be read
    """
    path = head_path(journal)
    try:
        with path.open("rb") as file:
            text = file.read(LENGTH + 1)
    except FileNotFoundError:
        return None
    try:
        body = json.loads(text)
        head = Head(body["seq"], body["hash"])
    except (ValueError, KeyError, TypeError) as error:
        raise HeadError(f"{path} is no head of a journal") from error
    if type(head.seq) is not int or type(head.hash) is not str:
        raise HeadError(f"{path} is no head of a journal")
    return head


class HeadFile:
    """Writer of one journal's head; made with its first row, kept open."""

    def __init__(self, journal: Path) -> None:
        self._path = head_path(journal)
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
        # a new one appears whole or not at all
        new = self._path.with_name(f"{self._path.name}.{os.getpid()}")
        new.write_bytes(line)
        new.replace(self._path)
        return os.open(self._path, os.O_WRONLY | os.O_CLOEXEC)

    def close(self) -> None:
        """Close the file."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
