"""Progress of a long compile or plan on stderr: the present stage, and its start.

Stages shorter than some seconds print nothing. A thread prints, so that a long stage is reported
while it lasts.
"""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from messages.form import with_said

from .output import write_error_line

QUIET_S = 3.0  # a part compiled in less time is reported by its result alone
EVERY_S = 5.0  # seconds between lines; each stage after the first also begins with one


@dataclass(eq=False, slots=True)
class PartProgress:
    """The progress lines of the work on one part.

    Attributes
    ----------
    name : name of the part
    as_json : print JSON objects, one a line
    """

    name: str
    as_json: bool
    _stage: str = ""
    _began_s: float = field(default_factory=time.monotonic)
    _stage_began_s: float = field(default_factory=time.monotonic)
    _is_over: threading.Event = field(default_factory=threading.Event)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self, stage: str) -> None:
        """Note that a stage begins."""
        with self._lock:
            self._stage, self._stage_began_s = stage, time.monotonic()

    def end(self) -> None:
        """Print nothing from now on."""
        self._is_over.set()

    def watch(self) -> None:
        """Print the stage from time to time until the work ends; run in a thread of its own."""
        wait_s = QUIET_S
        while not self._is_over.wait(wait_s):
            write_error_line(self.line(time.monotonic()))
            wait_s = EVERY_S

    def line(self, now_s: float) -> str:
        """Return the line for an instant of the monotonic clock."""
        with self._lock:
            stage, since_s = self._stage, now_s - self._stage_began_s
        whole_s = now_s - self._began_s
        if self.as_json:
            body = {
                "event": "progress",
                "part": self.name,
                "stage": stage,
                "stage_s": round(since_s, 1),
                "seconds": round(whole_s, 1),
            }
            return json.dumps(with_said(body), ensure_ascii=False)
        return f"{self.name}: {stage} ({since_s:.0f} s of {whole_s:.0f} s so far)"


@contextmanager
def shown_progress(name: str, *, as_json: bool) -> Iterator[PartProgress]:
    """Yield the progress of one part, printed on stderr while it lasts.

    Parameters
    ----------
    name : name of the part
    as_json : print JSON objects, one a line
    """
    progress = PartProgress(name, as_json)
    thread = threading.Thread(target=progress.watch, name="progress", daemon=True)
    thread.start()
    try:
        yield progress
    finally:
        progress.end()
        thread.join()
