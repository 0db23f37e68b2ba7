"""Tracks the use of a device, so that a heartbeat never comes between two requests."""

import inspect
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final, TypeVar, cast

from drivers.clock import CellClock
from drivers.wires import LineTap

Device = TypeVar("Device")
# A stop must not wait, and does not count as use: the device may be asked whether it obeyed.
UNCOUNTED: Final = frozenset({"stop"})


class InUse:
    """Passes all calls on to a device, and counts the verbs under way.

    Parameters
    ----------
    device : with awaitable verbs
    clock : clock of the cell
    tap : recorder of the order in which verbs begin, or the enforcer of a recorded order; None for
        none
    """

    def __init__(self, device: object, clock: CellClock, tap: LineTap | None = None) -> None:
        self._device = device
        self._clock = clock
        self._tap = tap
        self._count = 0
        self._last_s = clock.now_s()

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the device has
        found = getattr(self._device, name)
        if name in UNCOUNTED or not inspect.iscoroutinefunction(found):
            return found

        async def verb(*args: object, **more: object) -> object:
            if self._tap is not None:
                await self._tap.turn(name)
                self._tap.taken(name)
            async with self._used():
                return await found(*args, **more)

        return verb

    @asynccontextmanager
    async def _used(self) -> AsyncIterator[None]:
        self._count += 1
        try:
            yield
        finally:
            self._count -= 1
            self._last_s = self._clock.now_s()

    def idle_s(self) -> float:
        """Return the time since the device was last used [cell s]; 0 while a verb runs."""
        return 0.0 if self._count else self._clock.now_s() - self._last_s


def counted(device: Device, clock: CellClock, tap: LineTap | None = None) -> tuple[Device, InUse]:
    """Return a device whose verbs are counted, and the counter.

    Parameters
    ----------
    device : with awaitable verbs
    clock : clock of the cell
    tap : recorder of the order in which verbs begin, or the enforcer of a recorded order; None for
        none
    """
    in_use = InUse(device, clock, tap)
    return cast(Device, in_use), in_use
