"""Write the journal, with two grades of safety (cell-facts.md 2).

Actions that may never be repeated without looking (grasp, release, hand-off, sort) and every change
of custody are on the disk before any byte goes to a device (``synchronous = FULL``). All other rows
survive the death of the process, but the last of them may be lost when the power fails.

A row is written at once, or by a thread of the journal's own (`write_behind`), for an event loop
that must not wait since it also stops an arm.
"""

import asyncio
import json
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from messages import say
from messages.form import with_said

from ._form import CELL_TIME, GENESIS, JournalError, RowKind, digest_of
from ._head import Head, HeadFile, head_path
from .place import OpenFiles
from .rows import Body, TextByName, name_of
from .stamps import HOST_STAMPS, Stamps
from .writing import BUSY_WALL_S, SCHEMA_VERSION, PendingRow, WriterThread, migrate

CELL_DECIMALS: Final = 3


class Journal:
    """Writer of one cell's journal. One instance per process; safe to call from all its threads.

    Parameters
    ----------
    path : path of the file
    run : run that writes
    stamps : the clocks that rows are stamped by

    Attributes
    ----------
    on_row : called with number, kind and name of each row once it is in the file
    cell_clock : reads the cell's clock [cell s], once there is one: the wall shows only roughly how
        long something took in an emulated cell, whose time stands still where the machine is slow
    on_failure : called from any thread, once, where a row of the writer thread cannot be
        written; from then on every row raises

    Raises
    ------
    JournalError : the file cannot be written, or is of another version
    """

    def __init__(self, path: Path, run: str, stamps: Stamps = HOST_STAMPS) -> None:
        self.path = path
        self.run = run
        self._stamps = stamps
        self._lock = threading.Lock()
        self.on_row: Callable[[int, str, str], None] | None = None
        self.cell_clock: Callable[[], float] | None = None
        self.on_failure: Callable[[JournalError], None] | None = None
        self._behind: WriterThread | None = None
        self._held: list[PendingRow] | None = None
        self._heads = [HeadFile(head_path(path))]
        self._secured: Head | None = None  # the last row of this writer that is surely on the disk
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(
                path, isolation_level=None, check_same_thread=False, timeout=BUSY_WALL_S
            )
            try:
                self._begin()
                self._files = OpenFiles(path)
            except BaseException:
                self._close()
                raise
        except (sqlite3.Error, OSError) as error:
            raise JournalError(
                say("journal {path}: {error}; nothing moves without it", path=path, error=error)
            ) from error

    def _begin(self) -> None:
        """Make the table if there is none. Two processes that begin a journal take turns."""
        until_s = time.monotonic() + BUSY_WALL_S
        while True:
            try:
                # Switching to WAL needs exclusive use of the file and does not wait for it.
                self._db.execute("PRAGMA journal_mode = WAL")
                self._db.execute("PRAGMA synchronous = NORMAL")
                version = require_known_version(self._db, self.path)
                if version != SCHEMA_VERSION:
                    migrate(self._db, version)
            except sqlite3.OperationalError as error:
                is_busy = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY
                if not is_busy or time.monotonic() > until_s:
                    raise
                time.sleep(0.01)
            else:
                return

    def write_behind(self) -> None:
        """Have rows written by a thread of the journal's own from now on.

        Then `write` returns 0 at once, and `write_secured` waits for a row for `PATIENCE_WALL_S` at
        most. Rows that cannot be written are reported to `on_failure`.
        """
        if self._behind is None:
            self._behind = WriterThread(self.path, self._append, self._close_file, self._fail)

    def _fail(self, error: JournalError) -> None:
        if self.on_failure is not None:
            self.on_failure(error)

    @contextmanager
    def held_back(self) -> Iterator[None]:
        """Keep the rows of the block, in order, until the block is over: metal comes first.

        Raises
        ------
        JournalError : one of them cannot be written
        """
        behind, self._held = self._behind, [] if self._behind is None else None
        if behind is not None:
            behind.hold()
        try:
            yield
        finally:
            if behind is not None:
                behind.go_on()
            self._let_go()

    def _let_go(self) -> None:
        held, self._held = self._held, None
        for entry in held or ():
            self._append(entry)

    def write(self, row: Body, part: int | None = None) -> int:
        """Append a row that survives the death of the process; return its number, 0 if pending."""
        return self.record(row.kind, name_of(row), self._body(row), part)

    async def write_secured(self, row: Body, part: int | None = None) -> int:
        """Append a row and return its number once it is on the disk."""
        return await self.secure(row.kind, name_of(row), self._body(row), part)

    def write_synced(self, row: Body) -> int:
        """Append a row as `write_secured` does, in this thread; return its number.

        Not for the event loop, which it holds until the row is on the disk.
        """
        return self._put(self._entry(row.kind, name_of(row), self._body(row), None, full=True))

    def write_about(self, run: str, row: Body, part: int | None = None) -> None:
        """Add a row to another run of this journal, which has ended; nothing if it has none.

        Parameters
        ----------
        run : the other run
        row : content of the row
        part : number of the part of that run that it is about
        """
        with self._lock:
            query = "SELECT 1 FROM journal WHERE run = ? LIMIT 1"
            is_there = self._db.execute(query, (run,)).fetchone() is not None
        if is_there:
            entry = self._entry(row.kind, name_of(row), self._body(row), part, full=False)
            entry.about = run
            self._put(entry)

    def _body(self, row: Body) -> dict[str, Any]:
        """Return a row's body with the instant on the cell's clock, if its model has the field."""
        body = row.as_json()
        if self.cell_clock is None or isinstance(row, TextByName):
            return body
        return {**body, CELL_TIME: round(self.cell_clock(), CELL_DECIMALS)}

    def record(
        self,
        kind: RowKind,
        name: str,
        body: Mapping[str, Any] | None = None,
        part: int | None = None,
    ) -> int:
        """Append any body as `write` does, content unchecked; return its number, 0 if not yet.

        Parameters
        ----------
        kind, name : kind and name of the row
        body : plain JSON values
        part : number of the part it is about
        """
        return self._put(self._entry(kind, name, body or {}, part, full=False))

    async def secure(
        self,
        kind: RowKind,
        name: str,
        body: Mapping[str, Any] | None = None,
        part: int | None = None,
    ) -> int:
        """Append any body as `write_secured` does; return the row's number.

        Parameters
        ----------
        kind, name : kind and name of the row
        body : plain JSON values
        part : number of the part it is about
        """
        entry = self._entry(kind, name, body or {}, part, full=True)
        if self._behind is None:
            return await asyncio.to_thread(self._append, entry)
        self._behind.put(entry)
        return await asyncio.to_thread(self._behind.wait, entry)

    def _entry(
        self, kind: RowKind, name: str, body: Mapping[str, Any], part: int | None, *, full: bool
    ) -> PendingRow:
        text = json.dumps(with_said(body), separators=(",", ":"), ensure_ascii=False)
        # File names may have bytes that are not text; the row matters more than their spelling.
        text = text.encode("utf-8", "backslashreplace").decode("utf-8")
        is_at_once = self._behind is None and self._held is None
        return PendingRow(kind, name, text, part, full, None if is_at_once else self._stamp())

    def _stamp(self) -> tuple[str, float]:
        utc = self._stamps.utc().isoformat(timespec="microseconds")
        return utc, self._stamps.monotonic_s()

    def _put(self, entry: PendingRow) -> int:
        if self._behind is not None:
            self._behind.put(entry)
            return self._behind.wait(entry) if entry.full else 0
        if self._held is not None and not entry.full:
            self._held.append(entry)
            return 0
        return self._append(entry)

    def _append(self, entry: PendingRow) -> int:
        if self._held:
            self._let_go()
        with self._lock:
            try:
                self._files.require_same()
                if entry.full:
                    self._db.execute("PRAGMA synchronous = FULL")
                # Another run may share the cell's journal. IMMEDIATE makes one lock cover both
                # reading and writing of number, time and chain.
                self._db.execute("BEGIN IMMEDIATE")
                try:
                    head = self._insert(entry)
                    self._db.execute("COMMIT")
                except BaseException:
                    if self._db.in_transaction:
                        self._db.execute("ROLLBACK")
                    raise
                if entry.full:
                    self._db.execute("PRAGMA synchronous = NORMAL")
                    self._note_head(head)
            except (sqlite3.Error, OSError) as error:
                raise JournalError(
                    say("journal {path}: {error}", path=self.path, error=error)
                ) from error
        if self.on_row is not None:
            self.on_row(head.seq, entry.kind, entry.name)
        return head.seq

    def _insert(self, entry: PendingRow) -> Head:
        t_utc, t_mono = entry.stamp or self._stamp()
        last = last_row(self._db)
        run = entry.about or self.run
        if entry.was_tried and last is not None and self._has(last.seq, run, t_utc, t_mono):
            return last
        seq, prev = (last.seq + 1, last.hash) if last else (1, GENESIS)
        fields = (run, entry.part, entry.kind, entry.name, entry.text)
        digest = digest_of(prev, seq, t_utc, t_mono, *fields)
        self._db.execute(
            "INSERT INTO journal VALUES (?,?,?,?,?,?,?,?,?,?)",
            (seq, t_utc, t_mono, *fields, prev, digest),
        )
        return Head(int(seq), digest)

    def _has(self, seq: int, run: str, t_utc: str, t_mono: float) -> bool:
        """Return whether the journal already has a row of this run with these stamps."""
        query = "SELECT 1 FROM journal WHERE seq = ? AND run = ? AND t_utc = ? AND t_mono = ?"
        return self._db.execute(query, (seq, run, t_utc, t_mono)).fetchone() is not None

    def keep_head(self, path: Path) -> None:
        """Name the last secured row in another file from now on, as in the head beside the journal.

        Parameters
        ----------
        path : path of that file

        Raises
        ------
        OSError : it cannot be written
        """
        with self._lock:
            file = HeadFile(path)
            if self._secured is not None:
                file.write(self._secured)
            self._heads.append(file)

    def _note_head(self, head: Head) -> None:
        self._secured = head
        for one in self._heads:
            one.write(head)

    def leave(self) -> None:
        """Close the file without a checkpoint, so that another writer need not wait."""
        with self._lock:
            self._close()

    def _close(self) -> None:
        for one in self._heads:
            one.close()
        self._db.close()

    def close(self) -> int:
        """Put everything on the disk, move the head to the last row, close the file.

        Returns
        -------
        rows that could not be written; those of the writer thread are tried once more before
        """
        if self._behind is not None:
            return self._behind.finish()
        self._close_file()
        return 0

    def _close_file(self) -> None:
        with self._lock:
            with suppress(sqlite3.Error, OSError):  # every secured row is on the disk already
                is_busy, *_ = self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
                last = last_row(self._db)
                if last is not None and not is_busy:
                    self._note_head(last)
            self._close()


def last_row(db: sqlite3.Connection) -> Head | None:
    """Return number and hash of the last row, None if the journal is empty."""
    row = db.execute("SELECT seq, hash FROM journal ORDER BY seq DESC LIMIT 1").fetchone()
    return Head(*row) if row else None


def require_known_version(db: sqlite3.Connection, path: Path) -> int:
    """Return the version of a journal.

    Raises
    ------
    JournalError : another version of cellctl has written it
    """
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if not 0 <= version <= SCHEMA_VERSION:
        raise JournalError(
            say(
                "journal {path} is of version {version}, this cellctl knows "
                "{schema_version}. Nothing has moved. Use the cellctl that wrote "
                "it, or another folder of runs (--runs)",
                path=path,
                version=version,
                schema_version=SCHEMA_VERSION,
            )
        )
    return int(version)
