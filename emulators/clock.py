"""Time of the emulated cell: world seconds, ``speed`` of which pass in one of the wall clock.

Models never look at a clock: time is handed to them. Only the servers that own a wire, and the
loop that steps the world, ask this one.
"""

import asyncio
import time
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class WorldClock:
    """Clock of one emulated cell; world time starts at zero when it is made.

    Attributes
    ----------
    speed : world seconds in one second of the wall clock
    """

    speed: float = 1.0
    started_wall_s: float = field(default_factory=time.monotonic)

    def now_s(self) -> float:
        """Return the world's instant [world s]."""
        return (time.monotonic() - self.started_wall_s) * self.speed

    def to_monotonic_s(self, world_s: float) -> float:
        """Return the CLOCK_MONOTONIC reading [wall s] of a world instant [world s]."""
        return self.started_wall_s + world_s / self.speed

    async def sleep(self, duration_s: float) -> None:
        """Wait for a duration [world s]."""
        await asyncio.sleep(max(0.0, duration_s) / self.speed)
