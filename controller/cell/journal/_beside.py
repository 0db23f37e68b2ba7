"""Append a row from outside a run, which may be writing and must not wait.

A secured row holds the journal's lock until it is on the disk. That is right for the run, whose
bytes wait for it, and wrong for a person at a desk. Here the lock is held for the row alone, and
the file is synced after the lock is released.
"""

import os
from pathlib import Path

from messages import say

from ._form import JournalError
from ._head import HeadError, HeadFile, head_path, read_head
from ._writer import Journal
from .place import LOG_SUFFIX
from .reading import row_at
from .rows import Body


def append_beside(path: Path, run: str, row: Body, part: int | None = None) -> int:
    """Append a row and return its number once it is on the disk.

    Parameters
    ----------
    path : path of the journal, which exists
    run : run that the row is about
    row : content of the row
    part : number of the part it is about

    Raises
    ------
    JournalError : there is no journal, or it cannot be written
    """
    if not path.is_file():
        raise JournalError(say("no journal at {path}", path=path))
    journal = Journal(path, run)
    try:
        seq = journal.write(row, part)
        # while the file is open: whoever closes it last takes the log away
        put_on_disk(path.with_name(path.name + LOG_SUFFIX), path, path.parent)
        _raise_head(path, seq)
    except (OSError, HeadError) as error:
        raise JournalError(say("journal {path}: {error}", path=path, error=error)) from error
    finally:
        journal.leave()
    return seq


def put_on_disk(*files: Path) -> None:
    """Flush files and folders to the disk, as far as they have been written.

    Raises
    ------
    OSError : one of them cannot be
    """
    for file in files:
        fd = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def _raise_head(path: Path, seq: int) -> None:
    """Set the head to a row that is on the disk, unless it is at a later one."""
    ours, there = row_at(path, seq), read_head(path)
    if ours is None or (there is not None and there.seq >= seq):
        return
    head = HeadFile(head_path(path))
    try:
        head.write(ours)
    finally:
        head.close()
