"""Stopping several devices side by side: none waits for another, least of all for a silent one."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import Arm, FixedGripper, LampUnit, Stop

log = logging.getLogger(__name__)

HALT_LIMIT_S = 2.0  # for the arm to confirm that it stands, while its task is being ended
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
    clock : of the cell
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


class Stopping:
    """Stops what can move and what shines; opens no jaw.

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
        DeviceError : it does not confirm
        """
        await self._arm.stop(kind)

    async def stop_all(self, kind: Stop) -> dict[str, Exception]:
        """Stop all devices side by side; return by name what each raised that did not confirm."""
        return await stop_side_by_side(
            {"arm": lambda: self._arm.stop(kind), **self._others()}, self._clock
        )

    async def stop_others(self) -> None:
        """Stop what is not the arm; a device that does not confirm is logged."""
        for name, error in (await stop_side_by_side(self._others(), self._clock)).items():
            log.warning("%s did not confirm the stop: %s", name, error)

    async def halt_arm(self) -> None:
        """Keep the arm from going on while a task unwinds; an answer is not insisted on."""
        with suppress(DeviceError, TimeoutError):
            async with self._clock.timeout(HALT_LIMIT_S):
                await self._arm.stop(Stop.DEAD)

    def _others(self) -> dict[str, Callable[[], Awaitable[object]]]:
        return {"gripper": lambda: self._gripper.stop(), "lights": lambda: self._lights.all_off()}
