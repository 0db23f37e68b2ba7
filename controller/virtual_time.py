"""An event loop on virtual time: without a clock of the computer, a selector or threads.

When nothing is ready, time jumps to the next timer. Subclasses decide the order of the ready
callbacks (`_run_once`), and provide the substitutes for the outside world.
"""

import asyncio
import heapq
from collections import deque
from collections.abc import Callable
from typing import Any, Final, TypeVarTuple

Arguments = TypeVarTuple("Arguments")

# shorter waits are below the resolution of a float of this size: time would not pass
MIN_WAIT_S: Final = 1e-9
PURGE_COUNT: Final = 200  # largest number of cancelled timers kept


class NothingLeftError(RuntimeError):
    """Nothing is ready and no timer is set: every task waits for another one."""


class VirtualTimeLoop(asyncio.BaseEventLoop):
    """The loop.

    Parameters
    ----------
    start_s : its first instant [s]
    """

    # asyncio's own, which its types do not show
    _ready: deque[Any]
    _scheduled: list[Any]
    _stopping: bool

    def __init__(self, start_s: float) -> None:
        super().__init__()
        self._now_s = start_s

    def time(self) -> float:
        """Return the instant [s]."""
        return self._now_s

    def call_later(
        self,
        delay: float,
        callback: Callable[[*Arguments], object],
        *args: *Arguments,
        context: Any = None,  # noqa: ANN401  (as asyncio has it)
    ) -> asyncio.TimerHandle:
        """Call something after a delay; return its timer. A delay above 0 lets time pass.

        Parameters
        ----------
        delay : until then [s]
        callback : function to call
        *args : arguments of the call
        context : context of the call
        """
        delay = max(delay, MIN_WAIT_S) if delay > 0 else delay
        return super().call_later(delay, callback, *args, context=context)

    def _take_ready(self) -> list[Any]:
        """Return all that is ready now; if nothing is, let time pass first."""
        self._purge()
        timers, ready = self._scheduled, self._ready
        if not ready and not self._stopping:
            if not timers:
                raise NothingLeftError(f"nothing is left to do at {self._now_s:.3f} s")
            self._now_s = max(self._now_s, timers[0]._when)
        while timers and timers[0]._when <= self._now_s:
            timer = heapq.heappop(timers)
            timer._scheduled = False
            ready.append(timer)
        batch: list[Any] = list(ready)
        ready.clear()
        return batch

    def _purge(self) -> None:
        timers = self._scheduled
        while timers and timers[0]._cancelled:
            heapq.heappop(timers)._scheduled = False
        if len(timers) > PURGE_COUNT and sum(t.cancelled() for t in timers) > len(timers) // 2:
            left = [timer for timer in timers if not timer.cancelled()]
            heapq.heapify(left)
            self._scheduled = left

    def _process_events(self, event_list: Any) -> None:  # noqa: ANN401
        raise AssertionError("there is no selector")

    def _write_to_self(self) -> None:
        """Nothing has to be woken: there is one thread."""
