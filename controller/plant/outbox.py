"""Sees that every notice of the journal reaches every receiver: in order, at least once.

The journal is the outbox; what is kept here is how far each receiver has confirmed it. The place is
moved after the confirmation, never before, so that whatever ends this process may double a notice
and loses none. A receiver that refuses one notice for good does not hold up the others: that one is
kept for a person (`cellctl deliveries`).
"""

import asyncio
import fcntl
import logging
import math
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from controller.cell.journal import (
    JOURNAL_NAME,
    NO_ROW,
    Head,
    JournalError,
    journal_mark,
    journals_in,
    last_head,
    row_at,
    whole_up_to,
)

from .folding import UntellableError, notices_after
from .model import Notice
from .plant import Courier, RejectedError

log = logging.getLogger(__name__)
FOLDER: Final = "connect"
BOOK: Final = "connect.sqlite"
LOCK: Final = "connect.lock"
POLL_WALL_S: Final = 0.2  # a result is to be on its way within a second of its row
FIRST_PAUSE_WALL_S: Final = 1.0
LONGEST_PAUSE_WALL_S: Final = 300.0
REFUSED_TRIES: Final = 3  # a receiver may refuse for a moment what it takes after a restart
BUSY_WALL_S: Final = 10.0
# A place behind rows that tell nothing is stored this often: a row comes each 0.1 s, and a place
# costs a sync of the disk; after a crash these rows are read once more.
STORE_WALL_S: Final = 10.0

TABLES: Final = """
CREATE TABLE IF NOT EXISTS couriers (
    name TEXT NOT NULL, journal TEXT NOT NULL, seq INTEGER NOT NULL, hash TEXT NOT NULL,
    PRIMARY KEY (name, journal));
CREATE TABLE IF NOT EXISTS refused (
    name TEXT NOT NULL, key TEXT NOT NULL, body TEXT NOT NULL, why TEXT NOT NULL, at TEXT NOT NULL,
    PRIMARY KEY (name, key));
CREATE TABLE IF NOT EXISTS problems (
    name TEXT PRIMARY KEY, why TEXT NOT NULL, at TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS orders (
    place INTEGER PRIMARY KEY AUTOINCREMENT, number TEXT NOT NULL UNIQUE, body TEXT NOT NULL,
    is_over INTEGER NOT NULL);
"""


class OutboxError(Exception):
    """The bridge's own file cannot be used, or another bridge has it."""


@dataclass(frozen=True, slots=True)
class ConfirmedHead:
    """How far a receiver has confirmed a journal."""

    courier: str
    journal: str
    head: Head


@dataclass(frozen=True, slots=True)
class RefusedNotice:
    """A notice that a receiver will not take, or that cannot be made.

    Attributes
    ----------
    key : what it is known by
    body : as JSON; empty where it cannot be made
    """

    courier: str
    key: str
    body: str
    why: str
    at: str


class Book:
    """The bridge's own file: places of receivers, refused notices, orders.

    Parameters
    ----------
    runs_dir : folder of all runs

    Raises
    ------
    OutboxError : it cannot be made or read
    """

    def __init__(self, runs_dir: Path) -> None:
        self.folder = runs_dir / FOLDER
        self._path = self.folder / BOOK
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with self._open() as db:
                db.executescript(TABLES)
        except (OSError, sqlite3.Error) as error:
            raise OutboxError(f"{self._path}: {error}") from error

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Be the only bridge of this folder of runs.

        Raises
        ------
        OutboxError : another one is
        """
        path = self.folder / LOCK
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            try:
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise OutboxError(
                    f"{path}: another `cellctl connect` serves this folder of runs"
                ) from error
            yield
        finally:
            os.close(fd)

    def confirmed_heads(self) -> tuple[ConfirmedHead, ...]:
        """Return how far each receiver is, in each journal."""
        with self._open() as db:
            found = db.execute("SELECT name, journal, seq, hash FROM couriers ORDER BY name")
            return tuple(
                ConfirmedHead(name, journal, Head(seq, digest))
                for name, journal, seq, digest in found
            )

    def confirmed_head(self, courier: str, journal: str) -> Head | None:
        """Return how far a receiver is in a journal; None before it began."""
        wanted = (
            one
            for one in self.confirmed_heads()
            if (one.courier, one.journal) == (courier, journal)
        )
        return next((one.head for one in wanted), None)

    def set_confirmed_head(self, courier: str, journal: str, head: Head) -> None:
        """Note how far a receiver is; on the disk when this returns.

        Parameters
        ----------
        courier : its name
        journal : key of the journal
        head : the last row that it has confirmed
        """
        with self._open() as db:
            db.execute(
                "INSERT INTO couriers VALUES (?, ?, ?, ?) ON CONFLICT (name, journal) DO UPDATE "
                "SET seq = excluded.seq, hash = excluded.hash",
                (courier, journal, head.seq, head.hash),
            )

    def refuse(self, courier: str, key: str, body: str, why: str) -> None:
        """Keep a notice for a person.

        Parameters
        ----------
        courier : receiver that refuses it
        key : what it is known by
        body : as JSON; empty where it cannot be made
        why : the receiver's reason
        """
        now = datetime.now(UTC).isoformat(timespec="seconds")
        with self._open() as db:
            db.execute(
                "INSERT OR REPLACE INTO refused VALUES (?, ?, ?, ?, ?)",
                (courier, key, body, why[:2000], now),
            )

    def refused(self) -> tuple[RefusedNotice, ...]:
        """Return the notices that wait for a person, oldest first."""
        with self._open() as db:
            found = db.execute("SELECT name, key, body, why, at FROM refused ORDER BY at")
            return tuple(RefusedNotice(*row) for row in found)

    def drop_refused(self, courier: str, key: str) -> bool:
        """Forget a refused notice; return False if there is none."""
        with self._open() as db:
            gone = db.execute("DELETE FROM refused WHERE name = ? AND key = ?", (courier, key))
            return gone.rowcount > 0

    def note_problem(self, courier: str, why: str) -> None:
        """Note why nothing goes out to a receiver.

        Parameters
        ----------
        courier : its name
        why : as a sentence; empty once all is well
        """
        now = datetime.now(UTC).isoformat(timespec="seconds")
        with self._open() as db:
            db.execute("DELETE FROM problems WHERE name = ?", (courier,))
            if why:
                db.execute("INSERT INTO problems VALUES (?, ?, ?)", (courier, why[:2000], now))

    def problems(self) -> dict[str, tuple[str, str]]:
        """Return why nothing goes out, and since when, by receiver."""
        with self._open() as db:
            found = db.execute("SELECT name, why, at FROM problems")
            return {name: (why, at) for name, why, at in found}

    def orders(self, *, are_open: bool = False) -> list[str]:
        """Return orders as JSON, oldest first; all, or those that are not over."""
        with self._open() as db:
            query = "SELECT body FROM orders WHERE is_over <= ? ORDER BY place"
            return [body for (body,) in db.execute(query, (0 if are_open else 1,))]

    def put_order(self, number: str, body: str, *, is_over: bool) -> None:
        """Keep an order; on the disk when this returns.

        Parameters
        ----------
        number : the plant's own
        body : the order as JSON
        is_over : nothing more happens to it
        """
        with self._open() as db:
            db.execute(
                "INSERT INTO orders (number, body, is_over) VALUES (?, ?, ?) "
                "ON CONFLICT (number) DO UPDATE SET body = excluded.body, "
                "is_over = excluded.is_over",
                (number, body, int(is_over)),
            )

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        try:
            with closing(sqlite3.connect(self._path, timeout=BUSY_WALL_S)) as db:
                db.execute("PRAGMA synchronous = FULL")
                with db:
                    yield db
        except sqlite3.Error as error:
            raise OutboxError(f"{self._path}: {error}") from error


def journals_of(runs_dir: Path) -> tuple[tuple[str, Path], ...]:
    """Return key and file of the journals of a folder: those set aside, then the one in use.

    Raises
    ------
    JournalError : one cannot be read
    """
    keyed = [(row_at(path, 1), path) for path in journals_in(runs_dir)]
    return tuple((first.hash, path) for first, path in keyed if first is not None)


class Outbox:
    """Delivers what the journals tell to one receiver.

    Parameters
    ----------
    runs_dir : folder of all runs
    book : remembers how far the receiver is
    courier : the receiver
    cell : name of the cell
    from_start : a receiver that is new gets all that the journals have, not only what comes
    """

    def __init__(
        self, runs_dir: Path, book: Book, courier: Courier, cell: str, *, from_start: bool = False
    ) -> None:
        self._runs_dir = runs_dir
        self._book = book
        self._courier = courier
        self._cell = cell
        self._from_start = from_start
        self._mark: object = None
        # By journal: the place that is stored, and the row behind it up to which nothing is told.
        self._passed: dict[str, tuple[Head | None, Head]] = {}
        self._stored_wall_s = -math.inf

    async def run(self) -> None:
        """Deliver until cancelled."""
        pause_s, told = FIRST_PAUSE_WALL_S, ""
        await asyncio.to_thread(self._book.note_problem, self._courier.name, "")
        while True:
            try:
                await self.deliver_new()
            except (OSError, TimeoutError, JournalError, OutboxError) as error:
                # one that is away for three days is asked every five minutes
                why, self._mark = str(error) or type(error).__name__, None
                if why != told:
                    told = why
                    log.warning("%s: %s", self._courier.name, why)
                    with suppress(OutboxError):  # its file is the problem
                        await asyncio.to_thread(self._book.note_problem, self._courier.name, why)
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, LONGEST_PAUSE_WALL_S)
            else:
                pause_s = FIRST_PAUSE_WALL_S
                if told:
                    told = ""
                    await asyncio.to_thread(self._book.note_problem, self._courier.name, "")
                await asyncio.sleep(POLL_WALL_S)

    async def deliver_new(self) -> None:
        """Deliver all that the journals have and the receiver has not.

        Raises
        ------
        OSError, TimeoutError : the receiver is not there
        JournalError : a journal cannot be read
        OutboxError : the receiver is further than a journal, or the bridge's file cannot be used
        """
        mark = await asyncio.to_thread(journal_mark, self._runs_dir / JOURNAL_NAME)
        if mark == self._mark:
            await self._store_passed()
            return
        await asyncio.to_thread(self._begin)
        every = await asyncio.to_thread(journals_of, self._runs_dir)
        for key, path in every:
            await self._deliver_from(key, path)
        self._mark = mark

    def _begin(self) -> None:
        """Give a receiver that is new its place in the journals that are there."""
        known = [one for one in self._book.confirmed_heads() if one.courier == self._courier.name]
        if known or self._from_start:
            return
        count = resume(self._runs_dir, self._book, self._courier.name)
        if count == 0:  # so that the first journal is told from its first row
            self._book.set_confirmed_head(self._courier.name, "", NO_ROW)

    async def _deliver_from(self, key: str, path: Path) -> None:
        """Deliver what a journal has behind the receiver's place, and move the place row by row."""
        name = self._courier.name
        stored = await asyncio.to_thread(self._book.confirmed_head, name, key)
        head = await self._passed_from(key, path, stored) or stored
        seq = 0 if head is None else head.seq
        if head is not None and seq and await asyncio.to_thread(row_at, path, seq) != head:
            raise OutboxError(
                f"{path}: {name} has confirmed row {seq}, which this journal does not have: it was "
                f"restored from a backup, or replaced. `cellctl deliveries --resume {name}` goes "
                "on from the journal's end as it is now"
            )
        whole, broken = await asyncio.to_thread(whole_up_to, path, head or NO_ROW)
        while seq < whole.seq:
            told, last = await asyncio.to_thread(notices_after, path, self._cell, seq, whole.seq)
            for at, notices in told:
                for notice in notices:
                    await self._send(notice)
                await self._confirm(key, path, at)
            if (not told or told[-1][0] < last) and (
                head := await asyncio.to_thread(row_at, path, last)
            ):
                stored = await asyncio.to_thread(self._book.confirmed_head, name, key)
                self._passed[key] = (stored, head)
            seq = last
        await self._store_passed()
        if broken is not None:
            raise OutboxError(
                f"{path}: row {broken.seq} of run {broken.run} {broken.why}; nothing from there on "
                f"is sent (`cellctl verify`). `cellctl deliveries --resume {name}` goes on from "
                "the journal's end"
            )

    async def _confirm(self, key: str, path: Path, seq: int) -> None:
        head = await asyncio.to_thread(row_at, path, seq)
        if head is not None:
            await asyncio.to_thread(self._book.set_confirmed_head, self._courier.name, key, head)
        self._passed.pop(key, None)

    async def _passed_from(self, key: str, path: Path, stored: Head | None) -> Head | None:
        """Return the row up to which nothing is told behind a stored place; None if not known.

        It does not hold where a person has set the place meanwhile, or the journal is another one.
        """
        before, passed = self._passed.get(key, (None, NO_ROW))
        is_known = bool(passed.seq) and before == stored
        if is_known and await asyncio.to_thread(row_at, path, passed.seq) == passed:
            return passed
        self._passed.pop(key, None)
        return None

    async def _store_passed(self) -> None:
        """Store the places behind rows that tell nothing, if it is time."""
        if not self._passed or time.monotonic() < self._stored_wall_s + STORE_WALL_S:
            return
        for key, (_, head) in self._passed.items():
            await asyncio.to_thread(self._book.set_confirmed_head, self._courier.name, key, head)
        self._passed.clear()
        self._stored_wall_s = time.monotonic()

    async def _send(self, notice: Notice | UntellableError) -> None:
        if isinstance(notice, UntellableError):
            await asyncio.to_thread(
                self._book.refuse, self._courier.name, notice.key, "", str(notice)
            )
            return
        pause_s = FIRST_PAUSE_WALL_S
        for tried in range(REFUSED_TRIES):
            try:
                await self._courier.deliver(notice)
            except RejectedError as error:
                if tried + 1 < REFUSED_TRIES:
                    await asyncio.sleep(pause_s)
                    pause_s *= 2
                    continue
                body = notice.model_dump_json(by_alias=True)
                await asyncio.to_thread(
                    self._book.refuse, self._courier.name, notice.key, body, str(error)
                )
            return


def behind(runs_dir: Path, confirmed: ConfirmedHead) -> int | None:
    """Return how many rows of a journal a receiver has not confirmed; None if it is gone.

    Raises
    ------
    JournalError : a journal cannot be read
    """
    path = dict(journals_of(runs_dir)).get(confirmed.journal)
    return None if path is None else last_head(path).seq - confirmed.head.seq


def resume(runs_dir: Path, book: Book, courier: str) -> int:
    """Go on from the ends of the journals as they are now; return how many journals there are.

    Parameters
    ----------
    runs_dir : folder of all runs
    book : remembers how far receivers are
    courier : name of the receiver

    Raises
    ------
    JournalError : a journal cannot be read
    """
    every = journals_of(runs_dir)
    for key, path in every:
        book.set_confirmed_head(courier, key, last_head(path))
    return len(every)
