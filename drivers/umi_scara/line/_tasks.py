"""Turns on a line: a stop overtakes waiting requests."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from drivers.wires import LineTap


class Turns:
    """A lock that serves urgent callers before all others.

    Parameters
    ----------
    tap : tap of the line, which may hold a caller back; None for none
    """

    def __init__(self, tap: LineTap | None = None) -> None:
        self._tap = tap
        self._lock = asyncio.Lock()
        self._urgent_count = 0
        self._calm = asyncio.Event()
        self._calm.set()

    @property
    def is_stop_waiting(self) -> bool:
        """Whether an urgent caller has the line, or waits for it."""
        return self._urgent_count > 0

    @asynccontextmanager
    async def take(self, what: str, *, urgent: bool = False) -> AsyncIterator[None]:
        """Hold the line during the block, in which ``what`` is sent."""
        if self._tap is not None:
            await self._tap.turn(what)
        if urgent:
            self._urgent_count += 1
            self._calm.clear()
            try:
                async with self._lock:
                    self._note(what)
                    yield
            finally:
                self._urgent_count -= 1
                if not self._urgent_count:
                    self._calm.set()
            return
        while True:
            await self._calm.wait()
            async with self._lock:
                if self._urgent_count:  # a stop came while this turn was waiting in the queue
                    continue
                self._note(what)
                yield
                return

    def _note(self, what: str) -> None:
        if self._tap is not None:
            self._tap.taken(what)
