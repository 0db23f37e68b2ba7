"""Steps devices where no world does: a bench of emulators without pybullet."""

import asyncio
from collections.abc import Sequence
from typing import Final, Protocol

from emulators.clock import WorldClock

STEP_S: Final = 1 / 240  # the world's own step
_TICK_WALL_S: Final = 0.002


class Steppable(Protocol):
    """Something that lives in the world's time."""

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        ...


class Stepper:
    """Advances devices in equal steps up to the clock's present, from `start` to `aclose`."""

    def __init__(self, clock: WorldClock, devices: Sequence[Steppable]) -> None:
        self._clock = clock
        self._devices = tuple(devices)
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Begin; the time before now does not count."""
        self._task = asyncio.get_running_loop().create_task(self._run())

    async def aclose(self) -> None:
        """Stop."""
        if self._task is None:
            return
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self._task = None

    async def _run(self) -> None:
        done_s = self._clock.now_s()
        while True:
            while self._clock.now_s() - done_s >= STEP_S:
                for device in self._devices:
                    device.advance(STEP_S)
                done_s += STEP_S
            await asyncio.sleep(_TICK_WALL_S)
