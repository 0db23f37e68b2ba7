"""A camera played back: its calls compared one by one, its frames given when they came."""

import errno
import math
import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

from drivers.wire_file import WireRow
from drivers.wires import Taken

from .lines import Tape

Result = TypeVar("Result")


class PlayedCamera:
    """One camera of the recording; a `drivers.wires.CameraTap`.

    A frame whose picture nobody read is given with the flag that it is bad: it counts as a frame,
    and is passed over as it was.

    Parameters
    ----------
    tape : tape with its rows
    wire : its name
    fd : the number by which the loop knows it
    """

    def __init__(self, tape: Tape, wire: str, fd: int) -> None:
        self._tape = tape
        self.wire = wire
        self._rows = [row for row in tape.reader.rows if row.wire == wire]
        self._place = 0
        self._fd = fd
        self._picture: WireRow | None = None
        tape.loop.sources[fd] = self._next_ready_s

    def call(self, what: str, sent: bytes, do: Callable[[], bytes]) -> bytes:
        """Return the recorded answer.

        Parameters
        ----------
        what : its name
        sent : the struct as it is sent
        do : makes the call

        Raises
        ------
        OSError : the recorded one
        UnpluggedError : the call differs
        """
        tape = self._tape
        tape.require_same()
        while self._place < len(self._rows) and self._rows[self._place].kind != "call":
            self._place += 1  # frames that were in the queue when this was called are gone
        if self._place == len(self._rows):
            tape.differ(self.wire, None, None, sent, ("nothing more", what))
        row = self._rows[self._place]
        name, size, code = row.info
        data = tape.reader.data(row)
        if (name, data[:size]) != (what, sent):
            tape.differ(self.wire, row, data[:size], sent, (name, what))
        self._place += 1
        tape.request_count += 1
        if code:
            raise OSError(code, os.strerror(code))
        return data[size:]

    def _next_frame(self) -> WireRow | None:
        """Return the next frame, if no call comes before it."""
        for row in self._rows[self._place :]:
            if row.kind == "call":
                return None
            if row.kind == "frame":
                return row
        return None

    def _next_ready_s(self) -> float | None:
        row = self._next_frame()
        return None if row is None else self._tape.loop_s(row.at_s)

    def dequeue(self, do: Callable[[], bytes], stamp_us: Callable[[bytes], int]) -> Taken:
        """Return the next frame.

        Raises
        ------
        BlockingIOError : there is none yet
        OSError : the recorded one
        UnpluggedError : there is a difference
        """
        tape = self._tape
        tape.require_same()
        row = self._next_frame()
        # the loop's instant is a sum of floats, and the frame is due at it
        if row is None or tape.loop.time() < tape.loop_s(row.at_s) - 1e-9:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        while self._rows[self._place] is not row:
            self._place += 1
        self._place += 1
        stamp_s, code = row.info
        if code:
            raise OSError(code, os.strerror(code))
        after = self._rows[self._place] if self._place < len(self._rows) else None
        self._picture = after if after is not None and after.kind == "picture" else None
        # rounded up: a frame that was exposed late enough must not seem too early
        at_us = math.ceil(tape.loop_s(stamp_s) * 1e6)
        return Taken(tape.reader.data(row), at_us, is_unread=self._picture is None)

    def picture(self, do: Callable[[], bytes]) -> bytes:
        """Return the picture of the frame that was dequeued last."""
        if self._picture is None:
            self._tape.differ(self.wire, None, None, None, ("passed over", "a picture"))
        assert self._picture is not None
        self._tape.request_count += 1
        return self._tape.reader.data(self._picture)

    def readiness_fd(self, do: Callable[[], int]) -> int:
        """Return the number by which the loop knows the camera."""
        return self._fd

    def other(self, do: Callable[[], Any]) -> Any:  # noqa: ANN401
        """Do nothing; return None."""
        return None


class AtOnce(Executor):
    """Makes calls at once, where they are ordered: on a recording's clock no call takes time."""

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> "Future[Result]":  # noqa: ANN401
        """Call; return a future that is done.

        Parameters
        ----------
        fn : function to call
        *args, **kwargs : arguments of the call
        """
        done: Future[Result] = Future()
        try:
            done.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001  whatever it raises is the caller's
            done.set_exception(error)
        return done
