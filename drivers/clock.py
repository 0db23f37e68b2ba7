"""Time as a service: one factor that clock, time-outs and an emulated cell share.

A cell second is a real second divided by ``speed``. Drivers state every duration in cell
seconds and ask the clock to wait, so that one driver serves the real cell (speed 1) and an
emulated one that runs faster. Nothing here knows a device.
"""

import asyncio
import time
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CellClock:
    """Clock of one cell.

    Attributes
    ----------
    speed : cell seconds that pass in one second of the wall clock; 1 on real devices
    min_timeout_wall_s : no time-out is shorter than this on the wall clock, since the jitter of
        the host's own scheduler does not shrink with ``speed`` [s]
    """

    speed: float = 1.0
    min_timeout_wall_s: float = 0.0

    def __post_init__(self) -> None:
        if not self.speed > 0:
            raise ValueError(f"speed must be positive, not {self.speed}")

    def now_s(self) -> float:
        """Return the present instant [cell s] on a monotonic scale."""
        return time.monotonic() * self.speed

    def from_monotonic_s(self, wall_s: float) -> float:
        """Return the cell instant [s] of a CLOCK_MONOTONIC reading [wall s]."""
        return wall_s * self.speed

    def to_wall_s(self, duration_s: float) -> float:
        """Return how long a duration [cell s] takes on the wall clock [s]."""
        return duration_s / self.speed

    async def sleep(self, duration_s: float) -> None:
        """Wait for a duration [cell s]."""
        await asyncio.sleep(max(0.0, duration_s) / self.speed)

    def timeout_wall_s(self, duration_s: float) -> float:
        """Return the wall-clock length [s] of a time-out of ``duration_s`` [cell s]."""
        return max(duration_s / self.speed, self.min_timeout_wall_s)

    def timeout(self, duration_s: float) -> AbstractAsyncContextManager[asyncio.Timeout]:
        """Return a context manager that raises ``TimeoutError`` after a duration [cell s]."""
        return asyncio.timeout(self.timeout_wall_s(duration_s))


REAL_TIME = CellClock()
