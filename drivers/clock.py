"""Time as a service: cell seconds, waits and time-outs.

Drivers state every duration in cell seconds and ask the clock to wait, so that one driver serves
the real cell and an emulated one that runs faster, or slower where the machine is slow. On a real
cell a cell second is a second. On an emulated one it is defined by the clock that world and drivers
share (``docs/shared-clock.md``, `_shared_time`). Nothing here knows a device.

Time-outs and staleness are measured in *attended* time: it stands still while this process could
not read its wires, so that a late reader is never taken for a late device.
"""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import (
    AbstractAsyncContextManager,
    asynccontextmanager,
    contextmanager,
    suppress,
)
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

from ._shared_time import SharedTime
from .attendance import BEAT_WALL_S, Attendance
from .patience import IN_TRANSIT_WALL_S, Patience

_Future = TypeVar("_Future", bound="asyncio.Future[Any]")

MIN_WAIT_WALL_S: Final = 0.0005  # a shorter wait would only spin while time stands still
# windows of a late reply in all: request read, reply sent, reply read
WINDOWS_A_REPLY_MAY_TAKE: Final = 3


@dataclass(frozen=True)
class CellClock:
    """Clock of one cell.

    Attributes
    ----------
    speed : cell seconds wanted per second of the wall clock; 1 on real devices
    min_timeout_wall_s : no time-out is shorter than this on the wall clock, where an emulated
        device shares the host without sharing a clock [s]
    shared : the clock of an emulated cell; None: the wall clock, times ``speed``
    monotonic : reads the wall clock [s]; where the event loop has a time of its own, that one
    beat_wall_s : interval at which a loop is checked for lateness while it is attended
    """

    speed: float = 1.0
    min_timeout_wall_s: float = 0.0
    shared: SharedTime | None = None
    monotonic: Callable[[], float] = field(default=time.monotonic, repr=False, compare=False)
    beat_wall_s: float = field(default=BEAT_WALL_S, repr=False, compare=False)
    _attendance: Attendance = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.speed > 0:
            raise ValueError(f"speed must be positive, not {self.speed}")
        attendance = Attendance(self.monotonic, self.beat_wall_s)
        object.__setattr__(self, "_attendance", attendance)  # frozen otherwise

    @classmethod
    def of_emulator(cls, path: Path) -> "CellClock":
        """Return the clock that an emulated cell keeps at ``path``.

        Raises
        ------
        LinkError : no emulator keeps a clock there
        """
        shared = SharedTime(path)
        return cls(speed=shared.speed, shared=shared)

    @property
    def waits(self) -> bool:
        """Whether cell time waits for this process once it attends."""
        return self.shared is not None and self.shared.waits

    # --- instants -----------------------------------------------------------------------------

    def now_s(self) -> float:
        """Return the present instant [cell s] on a monotonic scale."""
        if self.shared is not None:
            return self.shared.now_s()
        return self.monotonic() * self.speed

    def from_monotonic_s(self, wall_s: float) -> float:
        """Return the cell instant [s] of a CLOCK_MONOTONIC reading of the past [wall s]."""
        if self.shared is not None:
            return self.shared.from_monotonic_s(wall_s)
        return wall_s * self.speed

    def attended_s(self) -> float:
        """Return the present instant [cell s] on a scale that omits what this process missed.

        The scale is good for differences alone. It is that of `now_s` on a shared clock that waits
        for this process, and where nobody attends (see `attending`).
        """
        return self.now_s() - self._attendance.lost_s() * self.speed

    def unheld_s(self) -> float:
        """Return the present instant [cell s] on a scale that also omits last looks.

        The scale is good for differences alone. It is that of `attended_s` where no clock is
        shared: time that is not shared cannot be held.
        """
        return self.attended_s() - (0.0 if self.shared is None else self.shared.held_s())

    def to_wall_s(self, duration_s: float) -> float:
        """Return the least time that a duration [cell s] takes on the wall clock [s]."""
        return duration_s / self.speed

    # --- waiting ------------------------------------------------------------------------------

    async def sleep(self, duration_s: float) -> None:
        """Wait for a duration [cell s]."""
        if self.shared is None:
            await asyncio.sleep(max(0.0, duration_s) / self.speed)
            return
        until_s = self.now_s() + duration_s
        await asyncio.sleep(max(0.0, duration_s) / self.speed)
        while (left_s := until_s - self.now_s()) > 0:  # noqa: ASYNC110  (time has no event)
            await asyncio.sleep(max(left_s / self.speed, MIN_WAIT_WALL_S))

    def patience_s(self, duration_s: float) -> float:
        """Return the real length of a time-out of ``duration_s`` [cell s].

        A shared clock is exact to its window only; on a clock that is not shared the jitter of
        the host does not shrink with ``speed``.
        """
        if self.shared is not None:
            return duration_s + WINDOWS_A_REPLY_MAY_TAKE * self.shared.window_s
        return max(duration_s, self.min_timeout_wall_s * self.speed)

    def timeout(self, duration_s: float) -> AbstractAsyncContextManager[asyncio.Timeout]:
        """Return a context manager that raises ``TimeoutError`` after a duration [cell s].

        It is `asyncio.timeout` in attended time; data that has arrived by then is taken in first.
        """
        return Patience(self.attended_s, self.speed, self.patience_s(duration_s), self._holdable)

    async def wait(
        self,
        futures: Iterable[_Future],
        duration_s: float,
        *,
        return_when: str = asyncio.ALL_COMPLETED,
        looks_again: bool = False,
    ) -> None:
        """Wait as `asyncio.wait` does, for ``duration_s`` [cell s] of attended time at most.

        This is a pause that something may end, not a time-out: nothing is added to it.

        Parameters
        ----------
        futures : futures that may end the pause; left running when the time is over
        duration_s : the pause [cell s]; infinite waits without a limit
        return_when : futures that end it, as in `asyncio.wait`
        looks_again : True if missing data then counts as silence: take the last look of a `timeout`
        """
        if duration_s == math.inf:
            await asyncio.wait(futures, return_when=return_when)
            return
        with suppress(TimeoutError):
            holding = self._holdable if looks_again else None
            async with Patience(self.attended_s, self.speed, duration_s, holding):
                await asyncio.wait(futures, return_when=return_when)

    @property
    def _holdable(self) -> SharedTime | None:
        return self.shared if self.waits else None

    @contextmanager
    def held(self) -> Iterator[float]:
        """Slow time to a creep for a last look, if the clock can; yield the time to look [wall s].

        `timeout` does so by itself before it fires.
        """
        holdable = self._holdable
        if holdable is None:
            yield 0.0
            return
        holdable.hold()
        try:
            yield IN_TRANSIT_WALL_S
        finally:
            holdable.release()

    # --- attending ----------------------------------------------------------------------------

    @asynccontextmanager
    async def attending(self) -> AsyncIterator[None]:
        """Attend to the clock while the block runs: once per process, round all that waits.

        On a shared clock that waits this process takes part. On any other the delay of the event
        loop is measured.
        """
        beat: AbstractAsyncContextManager[None] = self._attendance.beating()
        if self.shared is not None and self.shared.waits:
            beat = self.shared.taking_part()
        elif self.shared is not None:
            self.shared.measure_speed()
        async with beat:
            yield

    def close(self) -> None:
        """Release a shared clock's file."""
        if self.shared is not None:
            self.shared.close()

    @property
    def missed_wall_s(self) -> float:
        """The time that this process has missed on a clock that does not wait [s]."""
        return self._attendance.lost_s()

    @property
    def speed_reached(self) -> float:
        """Cell seconds that passed in a second, since `attending` began; ``speed`` elsewhere."""
        reached = None if self.shared is None else self.shared.speed_reached()
        return self.speed if reached is None else reached


REAL_TIME = CellClock()
