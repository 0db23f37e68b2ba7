"""A time-out on a clock that may stand still. Knows asyncio, no device and no clock."""

import asyncio
from collections.abc import Callable
from types import TracebackType
from typing import Final, Protocol

# Bytes that have arrived when time is up must be read before they count as missing. The path of a
# byte from the kernel to the waiting task takes at most this many turns of the loop: reader,
# future, wait_for, task, wait, task, shield, caller.
TURNS: Final = 10
MIN_WAIT_WALL_S: Final = 0.001
# A busy kernel delays bytes of a pseudo-terminal: 18 ms seen at a load of 9, more than 50 ms at 18,
# against 0.1 ms on a socket. That delay is no device's silence: where the clock can be held, it is
# held while a request may still arrive, and its reply.
IN_TRANSIT_WALL_S: Final = 0.3


class Holdable(Protocol):
    """A clock that creeps on request."""

    def hold(self) -> None:
        """Slow time to a creep until `release`."""

    def release(self) -> None:
        """Resume time, once per `hold`."""


class Patience:
    """`asyncio.timeout` by another clock.

    Expiry, cancellation and nesting are `asyncio.Timeout`'s own: it is rescheduled to now when
    time is up.

    Parameters
    ----------
    now_s : the clock [cell s]; may stand still, never goes back
    speed : cell seconds in a wall second, when it does not stand still
    duration_s : until time is up [cell s]
    holding : the clock itself, where it can be held
    """

    def __init__(
        self,
        now_s: Callable[[], float],
        speed: float,
        duration_s: float,
        holding: Holdable | None = None,
    ) -> None:
        self._now_s = now_s
        self._speed = speed
        self._duration_s = duration_s
        self._until_s = 0.0
        self._turns_left = TURNS
        self._holding = holding
        self._is_held = False
        self._inner = asyncio.timeout(None)
        self._handle: asyncio.Handle | None = None

    async def __aenter__(self) -> asyncio.Timeout:
        await self._inner.__aenter__()
        self._until_s = self._now_s() + self._duration_s
        self._look()
        return self._inner

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._handle is not None:
            self._handle.cancel()
        if self._is_held and self._holding is not None:
            self._is_held = False
            self._holding.release()
        await self._inner.__aexit__(kind, error, traceback)

    def _look(self) -> None:
        loop = asyncio.get_running_loop()
        left_s = self._until_s - self._now_s()
        if left_s > 0:
            wait_wall_s = max(left_s / self._speed, MIN_WAIT_WALL_S)
            self._handle = loop.call_later(wait_wall_s, self._look)
        elif self._holding is not None and not self._is_held:
            self._is_held = True
            self._holding.hold()
            self._handle = loop.call_later(IN_TRANSIT_WALL_S, self._look)
        elif self._turns_left > 0:
            self._turns_left -= 1
            self._handle = loop.call_soon(self._look)
        else:
            self._inner.reschedule(loop.time())
