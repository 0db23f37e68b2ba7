"""The journal: what the cell did, append-only in SQLite, from the first event on.

Rows are chained by hash, so that a changed row shows. Two grades of safety (architecture.md 5.2,
5.4): what may never be repeated without looking (grip, release, hand-off, sort) and every change
of custody is on the disk before the bytes leave (``synchronous = FULL``); all else survives the
death of the process, and may lose its last rows when the power fails.
"""

import asyncio
import hashlib
import json
import sqlite3
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

Kind = Literal["event", "intent", "outcome", "observation", "decision", "custody", "config"]

SCHEMA = """
CREATE TABLE IF NOT EXISTS journal (
    seq       INTEGER PRIMARY KEY,
    t_utc     TEXT NOT NULL,
    t_mono    REAL NOT NULL,
    run       TEXT NOT NULL,
    part      INTEGER,
    kind      TEXT NOT NULL,
    name      TEXT NOT NULL,
    body      TEXT NOT NULL,
    prev_hash TEXT NOT NULL,
    hash      TEXT NOT NULL
) STRICT;
CREATE INDEX IF NOT EXISTS journal_run ON journal (run, seq);
CREATE TRIGGER IF NOT EXISTS journal_keeps_rows BEFORE UPDATE ON journal
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
CREATE TRIGGER IF NOT EXISTS journal_loses_none BEFORE DELETE ON journal
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
-- REPLACE takes rows away without asking the trigger on DELETE
CREATE TRIGGER IF NOT EXISTS journal_only_grows BEFORE INSERT ON journal
WHEN NEW.seq <= (SELECT coalesce(max(seq), 0) FROM journal)
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
"""
GENESIS = "0" * 64


class JournalError(Exception):
    """The journal cannot be written or read; nothing may move without it."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the journal; `t_mono_s` is of the machine's monotonic clock [wall s]."""

    seq: int
    t_utc: str
    t_mono_s: float
    run: str
    part: int | None
    kind: str
    name: str
    body: dict[str, Any]


def _digest(prev: str, *fields: object) -> str:
    text = json.dumps([prev, *fields], separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


class Journal:
    """Writer of one cell's journal. One instance a process; safe to call from its threads."""

    def __init__(self, path: Path, run: str) -> None:
        self.path = path
        self.run = run
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(
                path, isolation_level=None, check_same_thread=False, timeout=10.0
            )
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.executescript(SCHEMA)
        except (sqlite3.Error, OSError) as error:
            raise JournalError(f"journal {path}: {error}; nothing moves without it") from error

    def record(
        self, kind: Kind, name: str, body: Mapping[str, Any] | None = None, part: int | None = None
    ) -> int:
        """Append a row that survives the death of the process; return its number."""
        return self._write(kind, name, body or {}, part, full=False)

    async def secure(
        self, kind: Kind, name: str, body: Mapping[str, Any] | None = None, part: int | None = None
    ) -> int:
        """Append a row and return once it is on the disk."""
        return await asyncio.to_thread(self._write, kind, name, body or {}, part, full=True)

    def _write(
        self, kind: Kind, name: str, body: Mapping[str, Any], part: int | None, *, full: bool
    ) -> int:
        text = json.dumps(body, separators=(",", ":"), ensure_ascii=False)
        # file names may hold bytes that are no text; the row matters more than their spelling
        text = text.encode("utf-8", "backslashreplace").decode("utf-8")
        with self._lock:
            try:
                if full:
                    self._db.execute("PRAGMA synchronous = FULL")
                # IMMEDIATE: number, time and chain are read under the same lock they are written
                # under, since another run may share the cell's journal
                self._db.execute("BEGIN IMMEDIATE")
                try:
                    seq = self._append(kind, name, text, part)
                    self._db.execute("COMMIT")
                except BaseException:
                    if self._db.in_transaction:
                        self._db.execute("ROLLBACK")
                    raise
                if full:
                    self._db.execute("PRAGMA synchronous = NORMAL")
            except sqlite3.Error as error:
                raise JournalError(f"journal {self.path}: {error}") from error
        return seq

    def _append(self, kind: Kind, name: str, text: str, part: int | None) -> int:
        t_utc = datetime.now(UTC).isoformat(timespec="microseconds")
        t_mono = time.monotonic()
        last = self._db.execute(
            "SELECT seq, hash FROM journal ORDER BY seq DESC LIMIT 1"
        ).fetchone()
        seq, prev = (last[0] + 1, last[1]) if last else (1, GENESIS)
        digest = _digest(prev, seq, t_utc, t_mono, self.run, part, kind, name, text)
        self._db.execute(
            "INSERT INTO journal VALUES (?,?,?,?,?,?,?,?,?,?)",
            (seq, t_utc, t_mono, self.run, part, kind, name, text, prev, digest),
        )
        return int(seq)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._db.close()


def read_rows(path: Path, run: str | None = None) -> Iterator[Row]:
    """Yield the rows of a journal in order, of one run or of all.

    Raises
    ------
    JournalError : no journal there
    """
    db = _open_to_read(path)
    try:
        query = "SELECT seq, t_utc, t_mono, run, part, kind, name, body FROM journal"
        rows = (
            db.execute(query + " ORDER BY seq")
            if run is None
            else db.execute(query + " WHERE run = ? ORDER BY seq", (run,))
        )
        for seq, t_utc, t_mono, run_id, part, kind, name, body in rows:
            yield Row(seq, t_utc, t_mono, run_id, part, kind, name, json.loads(body))
    except (sqlite3.Error, ValueError) as error:  # no database, or a body that is no JSON
        raise JournalError(f"journal {path}: {error}; it is damaged or no journal") from error
    finally:
        db.close()


def first_broken_row(path: Path) -> int | None:
    """Return the number of the first row whose hash does not fit, None if the chain is whole.

    Rows taken off the end leave a whole chain: only a copy of its last hash kept elsewhere tells.

    Raises
    ------
    JournalError : no journal there
    """
    db = _open_to_read(path)
    # a byte that is no text any more is a changed row like any other
    db.text_factory = lambda raw: raw.decode("utf-8", "replace")
    try:
        prev = GENESIS
        for row in db.execute("SELECT * FROM journal ORDER BY seq"):
            *fields, prev_hash, digest = row
            if prev_hash != prev or _digest(prev, *fields) != digest:
                return int(fields[0])
            prev = digest
    except sqlite3.Error as error:
        raise JournalError(f"journal {path}: {error}; it is damaged or no journal") from error
    finally:
        db.close()
    return None


def _open_to_read(path: Path) -> sqlite3.Connection:
    if not path.is_file():
        raise JournalError(f"no journal at {path}")
    # as a URI, since a folder's name may hold # ? or %
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
