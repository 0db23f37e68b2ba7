"""Read journals; this module never writes."""

import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from messages import say
from messages.form import from_said

from .._form import EARLIER_KINDS, GENESIS, JournalError, Row, RowKind, digest_of, kind_of
from .._writer import require_known_version
from ..rows import (
    ADDED,
    Acknowledged,
    CustodyChanged,
    PartFollowed,
    PartResumed,
    has_record,
    is_of,
)

COLUMNS: Final = "seq, t_utc, t_mono, run, part, kind, name, body"
# names of the rows that are written about a run after its end
ADDED_NAMES: Final = (*(body.row_name for body in ADDED), Acknowledged.row_name)


@dataclass(frozen=True, slots=True)
class BrokenRow:
    """A row that does not fit the chain, and why."""

    seq: int
    run: str
    part: int | None
    name: str
    why: str


def read_rows(path: Path, run: str | None = None) -> Iterator[Row]:
    """Yield the rows of a journal in order, of one run or of all runs.

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    yield from _rows(path, "" if run is None else " WHERE run = ?", () if run is None else (run,))


def read_rows_of_kinds(
    path: Path, kinds: Sequence[RowKind], events: Sequence[str], without: Sequence[str] = ()
) -> Iterator[Row]:
    """Yield the rows of some kinds, and the events of some names, of all runs, in order.

    Parameters
    ----------
    path : the journal
    kinds : kinds of rows
    events : names of events; "event" itself need not be among `kinds`
    without : names of rows of `kinds` that are left out; their bodies are not read

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    where = (
        f" WHERE (kind IN ({_marks(kinds)}) AND name NOT IN ({_marks(without)}))"
        f" OR (kind = 'event' AND name IN ({_marks(events)}))"
    )
    values = [*kinds, *without, *events]
    for name, (was, now) in EARLIER_KINDS.items():
        if now in kinds:
            where += " OR (kind = ? AND name = ?)"
            values += [was, name]
    yield from _rows(path, where, values)


def read_rows_named(path: Path, names: Sequence[str], since: str = "") -> Iterator[Row]:
    """Yield the rows of some names, of all runs, in order.

    Parameters
    ----------
    path : the journal
    names : of the rows
    since : time of the first row that counts (UTC, ISO 8601); empty for all

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    yield from _rows(path, f" WHERE name IN ({_marks(names)}) AND t_utc >= ?", [*names, since])


def read_rows_counted(path: Path, names: Sequence[str]) -> Iterator[Row]:
    """Yield the rows of some names, of all runs, in order; one run alone supplies each part.

    A part that went on in a later run has its rows in both. Those of the run that has its record
    count (ADR 37).

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    elsewhere = records_elsewhere(path)
    for row in read_rows_named(path, names):
        if (row.run, row.part) not in elsewhere:
            yield row


def records_elsewhere(path: Path) -> frozenset[tuple[str, int | None]]:
    """Return runs and numbers of parts whose record is in another run (ADR 37).

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    resumed: dict[tuple[str, int | None], PartResumed] = {}
    followed: dict[tuple[str, int | None], PartFollowed] = {}
    for row in read_rows_named(path, (PartResumed.row_name, PartFollowed.row_name)):
        if is_of(row, PartResumed):
            resumed[row.run, row.part] = PartResumed.model_validate(row.body)
        else:
            followed[row.run, row.part] = PartFollowed.model_validate(row.body)
    changes = read_rows_of_kinds(path, (CustodyChanged.kind,), ()) if resumed else ()
    known = {(row.run, row.part) for row in changes}
    return frozenset(
        key
        for key in {*resumed, *followed}
        if not has_record(followed.get(key), resumed.get(key), is_custody_known=key in known)
    )


def read_rows_after(path: Path, seq: int, run: str) -> Iterator[Row]:
    """Yield the rows of a run that were written after a row, in order.

    Parameters
    ----------
    path : the journal
    seq : number of the last row that is known, 0 for none
    run : its name

    Raises
    ------
    JournalError : no journal there, or one of another version
    """
    yield from _rows(path, " WHERE run = ? AND seq > ?", (run, seq))


def newest_run(path: Path) -> str | None:
    """Return the last run that wrote of itself; None if there is no row yet.

    Rows that people and reports add to a run once it has ended do not make it the newest.

    Raises
    ------
    JournalError : no journal there, or it cannot be read
    """
    with opened(path) as db:
        found = db.execute(
            f"SELECT run FROM journal WHERE name NOT IN ({_marks(ADDED_NAMES)}) "  # nosec B608
            "ORDER BY seq DESC LIMIT 1",
            ADDED_NAMES,
        ).fetchone()
    return None if found is None else str(found[0])


def _marks(values: Sequence[str]) -> str:
    return ", ".join("?" for _ in values)


def _rows(path: Path, where: str, values: Sequence[str | int]) -> Iterator[Row]:
    with opened(path) as db:
        require_known_version(db, path)
        query = f"SELECT {COLUMNS} FROM journal{where} ORDER BY seq"  # nosec B608
        yield from map(row_of, db.execute(query, tuple(values)))


def first_broken_row(path: Path) -> int | None:
    """Return the number of the first row whose hash does not fit, None if the chain is whole.

    Rows cut off the end leave the chain whole. Only a copy of its last hash, kept elsewhere, can
    reveal that.

    Raises
    ------
    JournalError : no journal there
    """
    found = next(_broken(path), None)
    return None if found is None else found.seq


def broken_rows(path: Path) -> list[BrokenRow]:
    """Return all rows that do not fit the chain, in order; empty if it is whole.

    A changed row is named itself; if its hash was made to fit, the row after it is. Rows cut off
    the end are not detected here.

    Raises
    ------
    JournalError : no journal there
    """
    return list(_broken(path))


def _broken(path: Path) -> Iterator[BrokenRow]:
    with opened(path) as db:
        db.text_factory = lossy_text
        yield from breaks(db.execute("SELECT * FROM journal ORDER BY seq"))


def lossy_text(raw: bytes) -> str:
    """Return text; a byte that can no longer be decoded makes a changed row like any other."""
    return raw.decode("utf-8", "replace")


def breaks(
    found: Iterable[tuple[Any, ...]], last_seq: int = 0, prev: str = GENESIS
) -> Iterator[BrokenRow]:
    """Yield the rows that do not fit the chain.

    Parameters
    ----------
    found : whole rows of the table in order
    last_seq, prev : number and hash of the row before them
    """
    for row in found:
        *fields, prev_hash, digest = row
        seq, _, _, run, part, _, name, _ = fields
        if digest_of(prev_hash, *fields) != digest:
            yield BrokenRow(seq, run, part, name, "was changed")
        elif seq != last_seq + 1:
            gap = f"{last_seq + 1} to {seq - 1}" if seq > last_seq + 2 else f"{seq - 1}"
            yield BrokenRow(seq, run, part, name, f"follows a gap: row {gap} was removed")
        elif prev_hash != prev:
            yield BrokenRow(
                seq, run, part, name, f"does not follow row {last_seq}, which was replaced"
            )
        last_seq, prev = seq, digest


def row_of(found: tuple[Any, ...]) -> Row:
    """Return the row of the values of `COLUMNS`.

    Raises
    ------
    ValueError : its body is no JSON, or no sentences
    """
    seq, t_utc, t_mono, run, part, kind, name, body = found
    return Row(
        seq, t_utc, t_mono, run, part, kind_of(kind, name), name, from_said(json.loads(body))
    )


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Yield a journal, open to be read.

    Raises
    ------
    JournalError : no journal there, or it cannot be read
    """
    if not path.is_file():
        raise JournalError(say("no journal at {path}", path=path))
    # as a URI, quoted by pathlib, since a folder's name may have # ? or % in it
    db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    try:
        yield db
    except (sqlite3.Error, ValueError) as error:  # no database, or a row that is none
        raise JournalError(
            say("journal {path}: {error}; it is damaged or not a journal", path=path, error=error)
        ) from error
    finally:
        db.close()
