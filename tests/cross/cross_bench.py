"""What every meeting of a driver with its emulator needs: world time, and nothing left behind."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from emulators.clock import WorldClock

TICK_WALL_S = 0.002
LONGEST_TICK_WALL_S = 0.01


async def live(world: WorldClock, advance: Callable[[float], None]) -> None:
    """Let world time pass until cancelled.

    A pause of the host does not count: time that nobody could act in would make every test of
    "while it moves" or "within a second" a matter of luck.
    """
    then_s = world.now_s()
    while True:
        await asyncio.sleep(TICK_WALL_S)
        now_s = world.now_s()
        advance(min(now_s - then_s, LONGEST_TICK_WALL_S * world.speed))
        then_s = now_s


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


async def until(is_so: Callable[[], bool], limit_wall_s: float = 10.0) -> None:
    """Wait until something is so."""
    async with asyncio.timeout(limit_wall_s):
        while not is_so():  # noqa: ASYNC110  (what is waited for has no event)
            await asyncio.sleep(0.001)


async def nothing_is_left(fds: set[str]) -> None:
    """Fail if a task runs or a descriptor is open that was not before."""
    await asyncio.sleep(0)  # transports close in the loop's next round
    assert asyncio.all_tasks() == {asyncio.current_task()}
    assert open_fds() == fds
