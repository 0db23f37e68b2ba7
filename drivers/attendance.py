"""The delay of this process's event loop: a device is not blamed for messages the loop missed."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

BEAT_WALL_S: Final = 0.02
JITTER_WALL_S: Final = 0.005  # a timer of a healthy loop is no later than this


class Attendance:
    """Measures the delay of the event loop by a regular beat.

    Time between a beat's due instant and the beat itself is lost: nothing that arrived meanwhile
    could be read.

    Parameters
    ----------
    now_s : reads the clock by which the delay is measured [s]; the wall's own unless ``speed``
        says otherwise, and one that may stand still
    beat_wall_s : from one beat to the next; a loop that can never be late needs hardly any
    speed : seconds of that clock in a wall second, when it does not stand still
    jitter_s : a delay no longer than this is none [s by that clock]
    """

    def __init__(
        self,
        now_s: Callable[[], float] = time.monotonic,
        beat_wall_s: float = BEAT_WALL_S,
        speed: float = 1.0,
        jitter_s: float = JITTER_WALL_S,
    ) -> None:
        self._now_s = now_s
        self._beat_wall_s = beat_wall_s
        self._allowed_s = beat_wall_s * speed + jitter_s
        self._lost_s = 0.0
        self._missed_from_s: float | None = None
        self.longest_s = 0.0

    def lost_s(self) -> float:
        """Return the time lost so far, including a delay that is still going on [s]."""
        return self._lost_s + self._late_s()

    def _late_s(self) -> float:
        return 0.0 if self._missed_from_s is None else max(0.0, self._now_s() - self._missed_from_s)

    def _expect(self) -> None:
        self._missed_from_s = self._now_s() + self._allowed_s

    @asynccontextmanager
    async def beating(self) -> AsyncIterator[None]:
        """Measure while the block runs."""
        self._expect()
        task = asyncio.create_task(self._beat(), name="loop delay")
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            self._lost_s, self._missed_from_s = self.lost_s(), None

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(self._beat_wall_s)
            late_s = self._late_s()
            self._lost_s += late_s
            self.longest_s = max(self.longest_s, late_s)
            self._expect()
