"""Stopping several devices side by side: none waits for another, least of all for a silent one."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping

from drivers.clock import CellClock

STOP_LIMIT_S = 3.0  # a silent arm is known after 0.5 s; a Modbus device has its own retries


async def stop_side_by_side(
    stops: Mapping[str, Callable[[], Awaitable[object]]],
    clock: CellClock,
    limit_s: float = STOP_LIMIT_S,
) -> dict[str, Exception]:
    """Call all stops at once; return what each device raised that did not confirm.

    Parameters
    ----------
    stops : per device, what stops it
    limit_s : patience with each [cell s]
    """

    async def one(stopping: Callable[[], Awaitable[object]]) -> Exception | None:
        try:
            async with clock.timeout(limit_s):
                await stopping()
        except Exception as error:  # noqa: BLE001 - the others must be stopped all the same
            return error
        return None

    found = await asyncio.gather(*(one(stopping) for stopping in stops.values()))
    return {name: error for name, error in zip(stops, found, strict=True) if error is not None}
