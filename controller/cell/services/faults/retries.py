"""Repeats failed device calls, as often as the fault policy allows.

For readings, pictures and lamps alone, which are safe to repeat. A motion, a grasp or a release is
never repeated here. The first failure stays in the journal.
"""

from collections.abc import Awaitable, Callable
from typing import Final, Literal, TypeVar

from controller.cell.alarms import alarm_of
from controller.cell.journal.rows import DeviceRetried
from controller.cell.machine import Act, FaultPolicy, next_rung
from drivers.clock import CellClock
from drivers.errors import DeviceError, FaultError, LinkError, RefusedError, UnpluggedError
from messages import say

from ..records import BatchRecord

Answer = TypeVar("Answer")
DeviceClass = Literal["camera", "lights", "gripper"]
# A device that is plugged in again refuses for a moment, and a stream that broke is set up anew.
# Bytes that the manual forbids, or another device at the address, are never tried again.
PASSING: Final = (LinkError, FaultError, RefusedError)


class Retries:
    """The fault policy, applied to devices whose calls may be repeated.

    Parameters
    ----------
    record : journals each retry with the error before it
    policy : function that returns the policy of the cell and of the current part's recipe
    clock : clock of the cell
    """

    def __init__(
        self, record: BatchRecord, policy: Callable[[], FaultPolicy], clock: CellClock
    ) -> None:
        self._record = record
        self._policy = policy
        self._clock = clock

    async def run(
        self,
        kind: DeviceClass,
        name: str,
        action: Callable[[], Awaitable[Answer]],
        mend: Callable[[], Awaitable[object]] | None = None,
    ) -> Answer:
        """Run an action and return its result; after an error wait, mend and try again.

        Parameters
        ----------
        kind : the class of fault
        name : name of the device, for the journal
        action : action to take; must be safe to repeat
        mend : connects the device again

        Raises
        ------
        DeviceError : the last one, once the policy ends; of a device that has left and could not be
            connected again, that it has left
        """
        tried = 0
        is_mended = True
        gone: UnpluggedError | None = None
        while True:
            try:
                if not is_mended and mend is not None:
                    await mend()
                is_mended, gone = True, None
                return await action()
            except PASSING as error:
                gone = error if isinstance(error, UnpluggedError) else gone
                if not await self._waits(kind, name, error, tried):
                    # it is not there when it is asked for again: no other fault than that it left
                    if gone is None or gone is error or not isinstance(error, LinkError):
                        raise
                    raise gone from error
                tried, is_mended = tried + 1, False

    async def _waits(self, kind: DeviceClass, name: str, error: DeviceError, tried: int) -> bool:
        """Wait for the next try after an error; return False if the policy has none."""
        rung = next_rung(self._policy().ladders[kind], tried)
        if rung.act is not Act.RETRY:
            return False
        self._record.note(
            DeviceRetried(
                device=name,
                error=str(error),
                number=tried + 1,
                delay_s=rung.delay_s,
                alarm=alarm_of("device_retried").number,
            )
        )
        self._record.show(say("{error}; trying again", error=error))
        await self._clock.sleep(rung.delay_s)
        return True
