"""Stop several devices in parallel: none waits for another, and so not for a silent one."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import Arm, FixedGripper, LampUnit, Stop

log = logging.getLogger(__name__)

# How long the arm may take to confirm that it has halted, while its task is being ended.
HALT_LIMIT_S = 2.0
# A silent arm is detected after 0.5 s; a Modbus device makes its own retries.
STOP_LIMIT_S = 3.0


async def stop_side_by_side(
    stops: Mapping[str, Callable[[], Awaitable[object]]],
    clock: CellClock,
    limit_s: float = STOP_LIMIT_S,
) -> dict[str, Exception]:
    """Call all stops at once; return the error of each device that did not confirm.

    Parameters
    ----------
    stops : the function that stops each device, by its name
    clock : of the cell
    limit_s : how long each may take [cell s]
    """

    async def one(stopping: Callable[[], Awaitable[object]]) -> Exception | None:
        try:
            async with clock.timeout(limit_s):
                await stopping()
        except Exception as error:  # noqa: BLE001 - the others must be stopped in any case
            return error
        return None

    found = await asyncio.gather(*(one(stopping) for stopping in stops.values()))
    return {name: error for name, error in zip(stops, found, strict=True) if error is not None}


class Stopping:
    """Stops everything that moves and switches off the lamps; opens no jaw.

    Parameters
    ----------
    arm, gripper, lights : the devices
    clock : of the cell
    """

    names = ("arm", "gripper", "lights")

    def __init__(self, arm: Arm, gripper: FixedGripper, lights: LampUnit, clock: CellClock) -> None:
        self._arm = arm
        self._gripper = gripper
        self._lights = lights
        self._clock = clock

    async def stop_arm(self, kind: Stop) -> None:
        """Stop the arm alone.

        Raises
        ------
        DeviceError : the arm does not confirm
        """
        await self._arm.stop(kind)

    async def stop_all(self, kind: Stop) -> dict[str, Exception]:
        """Stop all devices in parallel; return by name the error of each that did not confirm."""
        return await stop_side_by_side(
            {"arm": lambda: self._arm.stop(kind), **self._others()}, self._clock
        )

    async def stop_others(self) -> None:
        """Stop all devices but the arm; log each one that does not confirm."""
        for name, error in (await stop_side_by_side(self._others(), self._clock)).items():
            log.warning("%s did not confirm the stop: %s", name, error)

    async def halt_arm(self) -> None:
        """Halt the arm while a task unwinds; no confirmation is required."""
        with suppress(DeviceError, TimeoutError):
            async with self._clock.timeout(HALT_LIMIT_S):
                await self._arm.stop(Stop.DEAD)

    def _others(self) -> dict[str, Callable[[], Awaitable[object]]]:
        return {"gripper": lambda: self._gripper.stop(), "lights": lambda: self._lights.all_off()}
