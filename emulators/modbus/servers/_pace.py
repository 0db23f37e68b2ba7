"""Pacing: serial characters take world time, the host's timer has a grain of a millisecond."""

import asyncio
from dataclasses import dataclass
from typing import Final

from emulators.clock import WorldClock

TIMER_GRAIN_WALL_S: Final = 0.0005  # epoll rounds a wait up to whole milliseconds
TURNS: Final = 4  # turns of the loop from a byte in the kernel to the task that waits for it
JITTER_WALL_S: Final = 0.05  # a writer is not scheduled between two halves of one frame


@dataclass(frozen=True, slots=True)
class Pacer:
    """Waits for instants of the world without piling up the timer's rounding.

    Instants are absolute, so a wait that ran late makes the next one shorter; an instant that is
    nearer than half a millisecond of the wall clock counts as reached.
    """

    clock: WorldClock

    async def until(self, instant_s: float) -> None:
        """Wait until an instant [world s]."""
        ahead_s = instant_s - self.clock.now_s()
        if ahead_s > TIMER_GRAIN_WALL_S * self.clock.speed:
            await self.clock.sleep(ahead_s)

    def silence_s(self, duration_s: float, *, is_frame_complete: bool) -> float:
        """Return the time to listen for a silence of `duration_s` [world s].

        Bytes that stand in the middle of a frame are given the jitter of the host on top, since
        a gap there may be the scheduler's and not the wire's.
        """
        return (
            duration_s if is_frame_complete else max(duration_s, JITTER_WALL_S * self.clock.speed)
        )

    async def read_within(self, reader: asyncio.StreamReader, wait_s: float) -> bytes | None:
        """Return bytes that come within a time [world s], b"" at the stream's end, None for none.

        Data that has arrived when time is up still counts: the wire is as late as its reader.
        """
        reading = asyncio.ensure_future(reader.read(4096))
        silence = asyncio.ensure_future(self._silence(wait_s))
        try:
            await asyncio.wait({reading, silence}, return_when=asyncio.FIRST_COMPLETED)
            return reading.result() if reading.done() else None
        finally:
            await _ended(reading, silence)

    async def _silence(self, wait_s: float) -> None:
        await self.clock.sleep(wait_s)
        for _ in range(TURNS):
            await asyncio.sleep(0)


async def _ended(*tasks: "asyncio.Future[bytes] | asyncio.Future[None]") -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
