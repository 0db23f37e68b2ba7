"""The writer thread: rows reach the file in the order of their submission.

Only callers that secure a row wait for it, for `PATIENCE_WALL_S` at most. So an event loop that
submits rows is not held up by a stalled disk or by another program that has the file locked.
"""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as LateError
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from messages import say

from .._form import JournalError

BUSY_WALL_S: Final = 10.0  # longest wait for another writer
# A row that is not in the file by then fails the run: no other process knows of the cell's actions
# meanwhile. Longer than SQLite's own wait, whose error says more.
PATIENCE_WALL_S: Final = BUSY_WALL_S + 2.0


@dataclass(slots=True, eq=False)
class PendingRow:
    """A row on its way to the file.

    Attributes
    ----------
    kind, name, text, part : kind, name, text and part of the row; its body as JSON
    full : it is on the disk before it counts as written
    stamp : date (UTC, ISO) and instant of the monotonic clock [s]; None: when it is written
    about : the run that it is added to; empty for the one that writes
    since_s : time of its submission, by this computer's monotonic clock [s]
    was_tried : True if it may be in the file although writing it has failed
    done : future of its number
    """

    kind: str
    name: str
    text: str
    part: int | None
    full: bool
    stamp: tuple[str, float] | None = None
    about: str = ""
    since_s: float = field(default_factory=time.monotonic)
    was_tried: bool = False
    done: "Future[int]" = field(default_factory=Future)

    @property
    def is_refusable(self) -> bool:
        """Whether the row states an intent: once refused, it must not be written later."""
        return self.kind == "intent"


class WriterThread:
    """Writes entries in their order.

    After a failure the entries are kept, and tried once more when the thread ends: a lock that
    somebody held may be gone by then, and no row is left out in the middle.

    Parameters
    ----------
    path : path of the journal, for messages
    write : appends one entry to the file and returns its number
    close : closes the file
    on_failure : called once, from any thread, with the error that ends writing
    """

    def __init__(
        self,
        path: Path,
        write: Callable[[PendingRow], int],
        close: Callable[[], None],
        on_failure: Callable[[JournalError], None],
    ) -> None:
        self._path = path
        self._write = write
        self._close = close
        self._on_failure = on_failure
        self._lock = threading.Lock()
        self._left: deque[PendingRow] = deque()  # put in and not in the file, in their order
        self._queue: queue.SimpleQueue[PendingRow | None] = queue.SimpleQueue()
        self._may_write = threading.Event()
        self._may_write.set()
        self._failure: JournalError | None = None
        self._is_ending = False
        # a daemon: a disk that stalls for ever must not keep the process from ending
        self._thread = threading.Thread(target=self._run, daemon=True, name="journal")
        self._thread.start()

    def put(self, entry: PendingRow) -> None:
        """Have an entry written after those before it.

        Raises
        ------
        JournalError : an earlier one could not be written; this one is kept beside it
        """
        with self._lock:
            if self._is_ending:
                raise JournalError(say("journal {path}: is closed", path=self._path))
            failure = self._failure
            if failure is None or not entry.is_refusable:
                self._left.append(entry)
                self._queue.put(entry)
            oldest_s = self._left[0].since_s if self._left else entry.since_s
        if failure is None and time.monotonic() - oldest_s > PATIENCE_WALL_S:
            failure = self._fail(self._late())
        if failure is not None:
            raise failure

    def wait(self, entry: PendingRow) -> int:
        """Return the number of an entry once it is in the file.

        Raises
        ------
        JournalError : it is not, in time or at all; an intent will not be written any more
        """
        try:
            return entry.done.result(PATIENCE_WALL_S)
        except LateError:
            if entry.is_refusable and entry.done.cancel():
                self._forget(entry)
            raise self._fail(self._late()) from None

    def hold(self) -> None:
        """Begin no entry until `go_on`."""
        self._may_write.clear()

    def go_on(self) -> None:
        """Write again."""
        self._may_write.set()

    def finish(self) -> int:
        """Write the remaining rows, close the file and end; return the number of unwritten rows."""
        with self._lock:
            if not self._is_ending:
                self._is_ending = True
                self._queue.put(None)
        self._may_write.set()
        self._thread.join(PATIENCE_WALL_S)
        with self._lock:
            return len(self._left)

    def _run(self) -> None:
        while (entry := self._queue.get()) is not None:
            self._may_write.wait()
            if self._failure is not None:
                self._refuse(entry, self._failure)
            elif entry.done.set_running_or_notify_cancel():
                self._try(entry)
        with suppress(Exception):  # said already, and counted by whoever ends the thread
            while self._left:
                self._write(self._left[0])
                self._forget(self._left[0])
        self._close()

    def _try(self, entry: PendingRow) -> None:
        try:
            number = self._write(entry)
        except Exception as error:  # noqa: BLE001  whatever it is, nothing is recorded any more
            entry.was_tried = True
            known = (
                error
                if isinstance(error, JournalError)
                else JournalError(
                    say("journal {path}: {error}", path=self._path, error=repr(error))
                )
            )
            if entry.is_refusable:
                self._forget(entry)
            self._fail(known)
            entry.done.set_exception(known)
        else:
            self._forget(entry)
            entry.done.set_result(number)

    def _refuse(self, entry: PendingRow, failure: JournalError) -> None:
        """Report the failure to the waiter of an entry; keep the entry unless it is an intent."""
        if entry.is_refusable:
            self._forget(entry)
        if entry.done.set_running_or_notify_cancel():
            entry.done.set_exception(failure)

    def _forget(self, entry: PendingRow) -> None:
        with self._lock, suppress(ValueError):
            self._left.remove(entry)

    def _fail(self, error: JournalError) -> JournalError:
        """Take the first failure for that of the journal; return it."""
        with self._lock:
            if self._failure is not None:
                return self._failure
            self._failure = error
        self._on_failure(error)
        return error

    def _late(self) -> JournalError:
        return JournalError(
            say(
                "journal {path}: no row could be written for {patience_wall_s:.0f} "
                "s: the disk stalls, or another program has the file locked",
                path=self._path,
                patience_wall_s=PATIENCE_WALL_S,
            )
        )
