"""Stop several devices in parallel: none waits for another, and so not for a silent one."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import Arm, FixedGripper, LampUnit, Stop

log = logging.getLogger(__name__)

# Share of the allowed time for the first of two stops: the first is sent while the task that moves
# the arm is being ended, the second by the state that follows, which reports devices that did not
# confirm.
AT_ONCE_SHARE = 0.4
CONFIRM_S = 1.0


async def stop_side_by_side(
    stops: Mapping[str, Callable[[], Awaitable[object]]],
    clock: CellClock,
    limit_s: float = CONFIRM_S,
) -> dict[str, Exception]:
    """Call all stops at once; return the error of each device that did not confirm.

    Parameters
    ----------
    stops : the function that stops each device, by its name
    clock : clock of the cell
    limit_s : longest time for each [cell s]
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
    clock : clock of the cell
    confirm_s : a device that has not confirmed by then is reported [cell s]
    """

    names = ("arm", "gripper", "lights")

    def __init__(
        self,
        arm: Arm,
        gripper: FixedGripper,
        lights: LampUnit,
        clock: CellClock,
        confirm_s: float = CONFIRM_S,
    ) -> None:
        self._at_once_s = AT_ONCE_SHARE * confirm_s
        self._confirm_s = confirm_s - self._at_once_s
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

    async def stop_moving(self, *, is_arm: bool, is_fixed: bool) -> None:
        """Stop all motion at once; a fixed gripper that only holds would forget its hold.

        Parameters
        ----------
        is_arm : the arm moves, or its jaws
        is_fixed : the jaws of the fixed gripper move

        Raises
        ------
        Exception : error of the first device that does not confirm
        """
        stops: dict[str, Callable[[], Awaitable[object]]] = {}
        if is_arm:
            stops["arm"] = lambda: self._arm.stop(Stop.DEAD)
        if is_fixed:
            stops["gripper"] = lambda: self._gripper.stop()
        found = await stop_side_by_side(stops, self._clock, self._confirm_s)
        for error in found.values():
            raise error

    async def stop_all(self, kind: Stop) -> dict[str, Exception]:
        """Stop all devices in parallel; return by name the error of each that did not confirm."""
        return await stop_side_by_side(
            {"arm": lambda: self._arm.stop(kind), **self._others()}, self._clock, self._confirm_s
        )

    async def stop_others(self) -> None:
        """Stop all devices but the arm; log each one that does not confirm."""
        found = await stop_side_by_side(self._others(), self._clock, self._at_once_s)
        for name, error in found.items():
            log.warning("%s did not confirm the stop: %s", name, error)

    async def halt_arm(self) -> None:
        """Halt the arm while a task unwinds; no confirmation is required."""
        with suppress(DeviceError, TimeoutError):
            async with self._clock.timeout(self._at_once_s):
                await self._arm.stop(Stop.DEAD)

    def _others(self) -> dict[str, Callable[[], Awaitable[object]]]:
        return {"gripper": lambda: self._gripper.stop(), "lights": lambda: self._lights.all_off()}
