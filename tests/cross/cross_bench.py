"""What every test of a driver with its emulator needs: world time, and a clean end."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from drivers.clock import CellClock
from emulators.clock import SharedClock

TICK_WALL_S = 0.002
HANG_WALL_S = 600.0  # a guard, no measure: a busy machine takes its time


@asynccontextmanager
async def one_clock(speed: float) -> AsyncIterator[tuple[SharedClock, CellClock]]:
    """Share a clock between world and driver, as in a cell: a slow host slows both down."""
    world = SharedClock(speed)
    clock = CellClock.of_emulator(world.path)
    try:
        async with clock.attending():
            yield world, clock
    finally:
        clock.close()
        world.close()


class Living:
    """A bench whose models live through world time.

    Attributes
    ----------
    lived_s : instant that they have reached; the clock may be a window ahead of it [world s]
    """

    world: SharedClock
    lived_s: float

    def advance(self, dt_s: float) -> None:
        """Let time pass for the models [world s]."""
        raise NotImplementedError

    def catch_up(self) -> None:
        """Let the models reach the clock's instant."""
        self.advance(self.world.now_s() - self.lived_s)


async def live(bench: Living) -> None:
    """Let world time pass until cancelled."""
    while True:
        bench.catch_up()
        bench.world.tick(bench.lived_s)
        await asyncio.sleep(TICK_WALL_S)


async def end(task: "asyncio.Task[None]") -> None:
    """Cancel a task and see it off; raises what it died of before."""
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


def open_fds() -> set[str]:
    """Return what this process has open, each with its number in the kernel."""
    fds = set()
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the listing's own descriptor
            fds.add(f"{entry.name} {entry.readlink()}")
    return {fd for fd in fds if "/proc/" not in fd}


async def until(is_so: Callable[[], bool], limit_wall_s: float = HANG_WALL_S) -> None:
    """Wait until something is so; the limit is a guard against a hang."""
    async with asyncio.timeout(limit_wall_s):
        while not is_so():  # noqa: ASYNC110  (what is waited for has no event)
            await asyncio.sleep(0.001)


async def nothing_is_left(fds: set[str]) -> None:
    """Fail if a task runs or a descriptor is open that was not before."""
    await asyncio.sleep(0)  # transports close in the loop's next round
    assert asyncio.all_tasks() == {asyncio.current_task()}
    assert open_fds() - fds == set()  # what an earlier test left may go meanwhile
