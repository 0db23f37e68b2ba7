"""Pacing: serial characters take world time, the host's timer has a grain of a millisecond."""

import asyncio
from dataclasses import dataclass
from typing import Final

from emulators.clock import WorldClock

TIMER_GRAIN_WALL_S: Final = 0.0005  # epoll rounds a wait up to whole milliseconds
JITTER_WALL_S: Final = 0.01  # a writer is not scheduled between two halves of one frame


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

    def silence_wall_s(self, duration_s: float, *, is_frame_complete: bool) -> float:
        """Return how long to listen for a silence of `duration_s` [world s -> wall s].

        Bytes that stand in the middle of a frame are given the jitter of the host on top, since
        a gap there may be the scheduler's and not the wire's.
        """
        wall_s = duration_s / self.clock.speed
        return wall_s if is_frame_complete else max(wall_s, JITTER_WALL_S)


async def read_within(reader: asyncio.StreamReader, wait_wall_s: float) -> bytes | None:
    """Return bytes that come within a time [wall s], b"" at the stream's end, None for silence."""
    try:
        async with asyncio.timeout(wait_wall_s):
            return await reader.read(4096)
    except TimeoutError:
        return None
