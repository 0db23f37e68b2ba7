"""Short reads for a program that follows a journal while runs write it; this module never writes.

A reader that stays open prevents the writer's log from being emptied, so each read here opens the
file, reads its rows and closes it again.
"""

import sqlite3
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from .._form import GENESIS, Row
from .._head import Head
from .._writer import require_known_version
from ._reader import COLUMNS, BrokenRow, breaks, lossy_text, opened, row_of

BATCH_COUNT: Final = 2000  # rows that one read takes
UNBOUNDED: Final = 2**62  # no row has this number
NO_ROW: Final = Head(0, GENESIS)  # what stands before the first one
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class NewRows:
    """Rows of one part of a run, or of the run itself (part None), among those requested."""

    run: str
    part: int | None
    first_seq: int
    last_seq: int


def journal_mark(path: Path) -> tuple[int | None, ...]:
    """Return a mark that changes with a journal: inode, size and time; None for a missing file.

    Its first entry changes only with the file. Asking costs two looks at the folder: the journal
    is not opened.

    Raises
    ------
    OSError : the folder cannot be looked into
    """
    found: list[int | None] = []
    for one in (path, path.with_name(f"{path.name}-wal")):
        try:
            stat = one.stat()
        except FileNotFoundError:
            found.append(None)
        else:
            found += [stat.st_ino, stat.st_size, stat.st_mtime_ns]
    return tuple(found)


def row_at(path: Path, seq: int) -> Head | None:
    """Return number and hash of a row; None if the journal does not have it.

    Raises
    ------
    JournalError : no journal there, or one that cannot be read
    """

    def read(db: sqlite3.Connection) -> Head | None:
        found = db.execute("SELECT seq, hash FROM journal WHERE seq = ?", (seq,)).fetchone()
        return None if found is None else Head(int(found[0]), str(found[1]))

    return _read(path, read)


def last_head(path: Path) -> Head:
    """Return number and hash of the last row; of none, where there is none.

    Raises
    ------
    JournalError : no journal there, or one that cannot be read
    """

    def read(db: sqlite3.Connection) -> Head:
        found = db.execute("SELECT seq, hash FROM journal ORDER BY seq DESC LIMIT 1").fetchone()
        return NO_ROW if found is None else Head(int(found[0]), str(found[1]))

    return _read(path, read)


def whole_up_to(path: Path, after: Head = NO_ROW) -> tuple[Head, BrokenRow | None]:
    """Return the last row up to which the chain is intact, and the first one that does not fit.

    Parameters
    ----------
    path : the journal
    after : a row up to which it is known to be whole

    Raises
    ------
    JournalError : no journal there, one of another version, or one that cannot be read
    """
    while True:
        seq = after.seq

        def read(db: sqlite3.Connection, seq: int = seq) -> list[tuple[object, ...]]:
            db.text_factory = lossy_text
            query = "SELECT * FROM journal WHERE seq > ? ORDER BY seq LIMIT ?"
            return db.execute(query, (seq, BATCH_COUNT)).fetchall()

        batch = _read(path, read)
        broken = next(breaks(batch, after.seq, after.hash), None)
        for row in batch:
            if broken is not None and row[0] == broken.seq:
                return after, broken
            after = Head(int(str(row[0])), str(row[-1]))
        if len(batch) < BATCH_COUNT:
            return after, None


def new_rows(path: Path, after_seq: int, last_seq: int | None = None) -> tuple[NewRows, ...]:
    """Return the runs and parts with rows after a given row, by the first such row.

    Parameters
    ----------
    path : the journal
    after_seq : rows up to this one do not count
    last_seq : nor do rows after this one; None for no such row

    Raises
    ------
    JournalError : no journal there, one of another version, or one that cannot be read
    """
    query = (
        "SELECT run, nullif(part, 0), min(seq), max(seq) FROM journal "
        "WHERE seq > ? AND seq <= ? GROUP BY 1, 2 ORDER BY 3"
    )

    def read(db: sqlite3.Connection) -> tuple[NewRows, ...]:
        until = UNBOUNDED if last_seq is None else last_seq
        return tuple(NewRows(*row) for row in db.execute(query, (after_seq, until)))

    return _read(path, read)


def rows_behind(
    path: Path,
    seq: int,
    count: int = BATCH_COUNT,
    last_seq: int | None = None,
    names: Collection[str] = (),
) -> list[Row]:
    """Return the rows after a row, of all runs, in order; at most a number of them.

    Parameters
    ----------
    path : the journal
    seq : number of the last row that is known, 0 for none
    count : most rows
    last_seq : rows after this one are left out; None for no such row
    names : names of the rows; all if empty

    Raises
    ------
    JournalError : no journal there, one of another version, or one that cannot be read
    """
    until = UNBOUNDED if last_seq is None else last_seq
    where = f"seq > ? AND seq <= ?{_named(names)}"
    # nothing but question marks is put into it
    query = f"SELECT {COLUMNS} FROM journal WHERE {where} ORDER BY seq LIMIT ?"  # nosec B608
    values = (seq, until, *names, count)
    return _read(path, lambda db: [row_of(found) for found in db.execute(query, values)])


def parts_of(path: Path, run: str) -> tuple[int, ...]:
    """Return the numbers of the parts of a run, in order.

    Raises
    ------
    JournalError : no journal there, one of another version, or one that cannot be read
    """
    query = "SELECT DISTINCT part FROM journal WHERE run = ? AND part > 0 ORDER BY part"
    return _read(path, lambda db: tuple(int(part) for (part,) in db.execute(query, (run,))))


def rows_of_parts(
    path: Path,
    run: str,
    parts: Collection[int],
    last_seq: int | None = None,
    names: Collection[str] = (),
) -> list[Row]:
    """Return the rows of a run about some of its parts or about none, in order.

    Parameters
    ----------
    path : the journal
    run : its id
    parts : numbers of the parts
    last_seq : rows after this one are left out; None for no such row
    names : names of the rows; all if empty

    Raises
    ------
    JournalError : no journal there, one of another version, or one that cannot be read
    """
    until = UNBOUNDED if last_seq is None else last_seq
    is_about = f"coalesce(part, 0) = 0 OR part IN ({_marks(parts)})"
    where = f"run = ? AND seq <= ? AND ({is_about}){_named(names)}"
    # nothing but question marks is put into it
    query = f"SELECT {COLUMNS} FROM journal WHERE {where} ORDER BY seq"  # nosec B608
    values = (run, until, *parts, *names)
    return _read(path, lambda db: [row_of(found) for found in db.execute(query, values)])


def _named(names: Collection[str]) -> str:
    """Return the condition that a row has one of some names; none if there are no names."""
    return f" AND name IN ({_marks(names)})" if names else ""


def _marks(values: Collection[object]) -> str:
    return ", ".join("?" for _ in values)


def _read(path: Path, read: Callable[[sqlite3.Connection], T]) -> T:
    with opened(path) as db:
        require_known_version(db, path)
        return read(db)
