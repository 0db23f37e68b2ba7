"""A thread between a program that must not wait and a reader that may not read.

A terminal after Ctrl-S, a stalled ssh window or a pipe without a reader may block for any time. A
stop of the arm must not wait for it.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Final, TextIO

# Live lines that wait for their reader, some minutes of a run; further ones are left out. Lines
# that come once (questions, warnings, results) do not count: they are few.
LIVE_LINE_COUNT: Final = 1000
# In the end a reader gets as long as it takes something this often [wall s].
STALL_WALL_S: Final = 2.0
END_WALL_S: Final = 10.0  # longest wait for the reader; until then nobody else can take the cell

Write = Callable[[str], None]


class TextRelay:
    """Passes texts on in order, from a queue that delays nobody.

    Attributes
    ----------
    lost_count : live lines that were left out
    """

    def __init__(self) -> None:
        self.lost_count = 0
        self._waiting: deque[tuple[Write, str, bool]] = deque()
        self._live_count = 0
        self._is_ending = False
        self._changed = threading.Condition()
        # a daemon: a reader that never reads must not keep the process from ending
        self._thread = threading.Thread(target=self._run, daemon=True, name="output")
        self._thread.start()

    @property
    def is_behind(self) -> bool:
        """Whether the reader has not taken everything yet."""
        return bool(self._waiting)

    def put(self, write: Write, text: str, *, is_live: bool) -> None:
        """Have a text written; waits for nothing.

        Parameters
        ----------
        write : writes it, and may take as long as it likes
        text : text to write
        is_live : True if it is left out, and counted, where too many such texts wait
        """
        with self._changed:
            if is_live and self._live_count >= LIVE_LINE_COUNT:
                self.lost_count += 1
                return
            self._live_count += is_live
            self._waiting.append((write, text, is_live))
            self._changed.notify_all()

    def finish(self) -> bool:
        """Wait for the reader while it still reads; return whether it has taken everything."""
        with self._changed:
            self._is_ending = True
            self._changed.notify_all()
            until_s = time.monotonic() + END_WALL_S
            while self._waiting:
                count, left_s = len(self._waiting), until_s - time.monotonic()
                self._changed.wait(min(STALL_WALL_S, left_s))
                if len(self._waiting) == count or left_s <= 0:
                    return False
        self._thread.join()
        return True

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_ending)
                if not self._waiting:
                    return
                write, text, is_live = self._waiting[0]
            with suppress(Exception):  # whoever reads has left: known where it was written
                write(text)
            with self._changed:
                # taken off only now: until then the reader is behind
                self._waiting.popleft()
                self._live_count -= is_live
                self._changed.notify_all()


def write_whole(stream: TextIO, text: str) -> None:
    """Write a text past the stream's buffer, whose lock would delay the end of the process.

    Parameters
    ----------
    stream : a standard stream, or what stands in for one
    text : text to write

    Raises
    ------
    OSError : nobody reads it any more
    ValueError : the stream was closed
    """
    try:
        fd = stream.fileno()
    except (OSError, AttributeError):  # no file: as a test has it
        stream.write(text)
        stream.flush()
        return
    data = text.encode(stream.encoding or "utf-8", stream.errors or "strict")
    while data:
        data = data[os.write(fd, data) :]
