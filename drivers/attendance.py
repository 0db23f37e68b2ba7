"""How late this process's event loop is: a device is not blamed for what the loop missed."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

BEAT_WALL_S: Final = 0.02
JITTER_WALL_S: Final = 0.005  # a timer of a healthy loop is no later than this


class Attendance:
    """Measures the delay of the event loop by a beat that is due every so often.

    Time between a beat's due instant and the beat itself is lost: nothing that arrived meanwhile
    could be read.

    Parameters
    ----------
    monotonic : reads the clock that the event loop's timers keep [s]
    beat_wall_s : from one beat to the next; a loop that can never be late needs hardly any
    """

    def __init__(
        self,
        monotonic: Callable[[], float] = time.monotonic,
        beat_wall_s: float = BEAT_WALL_S,
    ) -> None:
        self._monotonic = monotonic
        self._beat_wall_s = beat_wall_s
        self._lost_wall_s = 0.0
        self._due_wall_s: float | None = None
        self.longest_wall_s = 0.0

    def lost_wall_s(self) -> float:
        """Return what has been lost so far, a delay that still goes on included [wall s]."""
        return self._lost_wall_s + self._late_wall_s()

    def _late_wall_s(self) -> float:
        if self._due_wall_s is None:
            return 0.0
        return max(0.0, self._monotonic() - self._due_wall_s - JITTER_WALL_S)

    @asynccontextmanager
    async def beating(self) -> AsyncIterator[None]:
        """Measure while the block runs."""
        self._due_wall_s = self._monotonic() + self._beat_wall_s
        task = asyncio.create_task(self._beat(), name="loop delay")
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            self._lost_wall_s, self._due_wall_s = self.lost_wall_s(), None

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(self._beat_wall_s)
            late_wall_s = self._late_wall_s()
            self._lost_wall_s += late_wall_s
            self.longest_wall_s = max(self.longest_wall_s, late_wall_s)
            self._due_wall_s = self._monotonic() + self._beat_wall_s
