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


async def live(world: SharedClock, advance: Callable[[float], None]) -> None:
    """Let world time pass until cancelled."""
    done_s = world.now_s()
    while True:
        now_s = world.now_s()
        advance(now_s - done_s)
        done_s = now_s
        world.tick(done_s)
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
