"""Check the whole of the cell's journal before a run writes to it; set a damaged one aside.

A damaged journal is never written to and never deleted: it gets another name, a new one begins
beside it, and the custody that the old one may have recorded counts as unknown. Other obstacles (a
folder in its place, no permission, another version) raise an error.
"""

import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from messages import key, say

from ._form import JOURNAL_NAME, JournalError
from ._head import SUFFIX, Head, HeadError, read_head
from ._writer import Journal, last_row, require_known_version
from .place import INDEX_SUFFIX, LOG_SUFFIX, why_not_there
from .reading import first_broken_row, read_rows_of_kinds
from .rows import JournalSetAside, PathBegun, is_once
from .stamps import HOST_STAMPS, Stamps
from .writing import MIGRATIONS

_COLUMNS: Final = (
    "seq", "t_utc", "t_mono", "run", "part", "kind", "name", "body", "prev_hash", "hash",
)  # fmt: skip
_DAMAGE: Final = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
_PARTS: Final = ("", LOG_SUFFIX, INDEX_SUFFIX, SUFFIX)
_SET_ASIDE: Final = "-set-aside-"  # stands in the name of a journal that was


@dataclass(frozen=True, slots=True)
class CellJournal:
    """An open journal, and the damaged one that was set aside for it.

    Attributes
    ----------
    notice : for the operator; empty if the journal was whole
    """

    journal: Journal
    notice: str = ""


def open_cell_journal(path: Path, run: str, stamps: Stamps = HOST_STAMPS) -> CellJournal:
    """Return the cell's journal, checked from its first row to its last.

    Parameters
    ----------
    path : path of the file
    run : run that is about to write
    stamps : the clocks that rows are stamped by

    Raises
    ------
    JournalError : it cannot be written, is of another version, or stands on a network file system;
        nothing may move without it
    """
    if why := why_not_there(path):
        raise JournalError(say("journal {path}: {why}. Nothing has moved", path=path, why=why))
    try:
        flaw = first_flaw(path)
        if flaw is None:
            return CellJournal(Journal(path, run, stamps))
        kept = _set_aside(path, stamps)
    except OSError as error:
        raise JournalError(
            say("journal {path}: {error}; nothing moves without it", path=path, error=error)
        ) from error
    journal = Journal(path, run, stamps)
    # lost in a power cut, it would leave a new journal that knows of no part
    journal.write_synced(JournalSetAside(why=flaw, file=kept.name))
    notice = say(
        "The journal {path} cannot be trusted: {flaw}. It is kept as "
        "{name}, and a new one begins. Its record of parts in the grippers "
        "is lost.",
        path=path,
        flaw=flaw,
        name=kept.name,
    )
    return CellJournal(journal, notice)


def first_flaw(path: Path) -> str | None:
    """Return the flaw of a damaged, cut, emptied or changed journal; None if it is whole.

    A journal that has not begun is whole, and so is one without rows that no head names. Rows cut
    off the end are noticed up to the row that the head names; a loss of later rows, written after
    the last secured row, may go unnoticed.

    Raises
    ------
    JournalError : not a file, not a journal of cellctl, not readable, or of another version
    OSError : the head cannot be read
    """
    try:
        head = read_head(path)
    except HeadError as error:
        return str(error)
    if not path.exists():
        return None if head is None else say("it is gone, its head names row {seq}", seq=head.seq)
    if not path.is_file():
        raise JournalError(
            say("journal {path}: is not a file; nothing moves without one. Move it away", path=path)
        )
    if path.stat().st_size == 0:
        return None if head is None else key("the file is empty")
    try:
        return _flaw_inside(path, head)
    except sqlite3.Error as error:
        # SQLite gives no error code for text that cannot be decoded
        if getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF in _DAMAGE:
            return str(error)
        raise JournalError(
            say("journal {path}: {error}; nothing moves without it", path=path, error=error)
        ) from error
    except UnicodeDecodeError as error:  # SQLite returned text that cannot be decoded
        return say("the file is damaged ({error})", error=error)


def _flaw_inside(path: Path, head: Head | None) -> str | None:
    db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=rw", uri=True, timeout=10.0)
    try:
        require_known_version(db, path)
        columns = tuple(row[1] for row in db.execute("PRAGMA table_info(journal)"))
        if columns != _COLUMNS:
            (count,) = db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
            if count == 0:
                return "it has no table"
            raise JournalError(
                say(
                    "journal {path}: is not a journal of cellctl; nothing moves "
                    "without one. Move the file away, or use another folder of runs "
                    "(--runs)",
                    path=path,
                )
            )
        (state,) = db.execute("PRAGMA quick_check(1)").fetchone()
        if state != "ok":
            return say("the file is damaged ({splitlines})", splitlines=state.splitlines()[-1])
        last = last_row(db)
        if last is None:
            return None if head is None else "it has no row"
        try:
            broken = first_broken_row(path)
        except JournalError as error:
            return str(error)
        if broken is not None:
            return say("row {broken} was changed, or rows before it were removed", broken=broken)
        return _flaw_at_the_end(db, path, head, last) or _flaw_of_the_table(db)
    finally:
        db.close()


def _flaw_at_the_end(
    db: sqlite3.Connection, path: Path, head: Head | None, last: Head
) -> str | None:
    if head is None:
        (version,) = db.execute("PRAGMA user_version").fetchone()
        # a journal without a version was written before there were heads
        return "its head is missing" if version and _has_secured(path) else None
    if head.seq > last.seq:
        return say(
            "it ends with row {last_seq}, its head names row {head_seq}: rows were cut off",
            last_seq=last.seq,
            head_seq=head.seq,
        )
    (found,) = db.execute("SELECT hash FROM journal WHERE seq = ?", (head.seq,)).fetchone()
    return (
        None if found == head.hash else say("row {seq} is not the one its head names", seq=head.seq)
    )


def _has_secured(path: Path) -> bool:
    """Return whether a journal has a row that is written only together with a head."""
    found = read_rows_of_kinds(path, ("custody", "intent"), (), without=(PathBegun.row_name,))
    return any(row.kind == "custody" or is_once(row) for row in found)


def journals_in(runs_dir: Path) -> tuple[Path, ...]:
    """Return the journals of a folder of runs: those set aside, then the one in use."""
    current = runs_dir / JOURNAL_NAME
    found = sorted(runs_dir.glob(f"{current.stem}{_SET_ASIDE}*{current.suffix}"))
    return (*found, *([current] if current.is_file() else []))


def is_set_aside(journal: Path) -> bool:
    """Return whether a journal has the name of one that was set aside."""
    return _SET_ASIDE in journal.name


def _flaw_of_the_table(db: sqlite3.Connection) -> str | None:
    """Return the flaw of the table, its index or its triggers; None if they are sound."""
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version == 0:
        return None  # opening the journal makes what is missing
    made = sqlite3.connect(":memory:")
    try:
        made.executescript("".join(MIGRATIONS[:version]))
        query = "SELECT type, name, sql FROM sqlite_schema ORDER BY type, name"
        is_same = made.execute(query).fetchall() == db.execute(query).fetchall()
    finally:
        made.close()
    return None if is_same else "its table or the triggers that keep its rows were changed"


def _set_aside(path: Path, stamps: Stamps) -> Path:
    """Rename a journal and the files that belong to it; return its new path."""
    stamp = f"{stamps.utc():%Y%m%d-%H%M%S}"
    number, kept = 1, path
    while any(kept.with_name(kept.name + part).exists() for part in _PARTS):
        more = "" if number == 1 else f"-{number}"
        kept = path.with_name(f"{path.stem}{_SET_ASIDE}{stamp}{more}{path.suffix}")
        number += 1
    for part in _PARTS:
        old = path.with_name(path.name + part)
        if old.exists():
            old.rename(kept.with_name(kept.name + part))
    return kept
