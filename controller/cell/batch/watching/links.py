"""Watchers of the links: a device silent at rest is noticed as soon as one in motion.

While a verb is under way the driver notices; between verbs a heartbeat does. The I/O block is
polled by its own driver, whose readings go stale (`InterlockWatcher`); cameras are asked for a
picture every few seconds anyway.
"""

import logging
import time
from collections.abc import Callable
from typing import Final

from drivers.attendance import Attendance
from drivers.clock import CellClock
from drivers.errors import DeviceError, LinkError, PositionLostError
from drivers.kinds import Arm, FixedGripper, LampUnit
from messages import key, say

from ...alarms import alarm_of, code_of
from ...devices.in_use import InUse
from ...journal.rows import LoopLate
from ...machine import Event
from ...services import Retries
from ...services.records import BatchRecord
from .conditions import Report

log = logging.getLogger(__name__)

# period below which no emulated device is polled, however fast time runs
MIN_BEAT_WALL_S: Final = 0.02
LOOP_REPORT_S: Final = 10.0


class ArmWatcher:
    """Turns an arm that is silent at rest, or has lost its positions, into a fault.

    A single implausible reading is ignored: the line may have been disturbed, and nothing moves.
    Two in a row are a fault.

    Parameters
    ----------
    arm : the device
    in_use : knows whether anything else is asked of it
    beat_s : longest idle time before it is polled [cell s]
    clock : clock of the cell
    """

    def __init__(self, arm: Arm, in_use: InUse, beat_s: float, clock: CellClock) -> None:
        self._arm = arm
        self._in_use = in_use
        self._clock = clock
        self._beat_s = max(beat_s, MIN_BEAT_WALL_S * clock.speed)

    async def run(self, report: Report) -> None:
        """Watch until cancelled, or until the arm is lost."""
        odd_count = 0
        while True:
            # exactly: what is idle for a beat is asked then, however often this was woken before
            left_s = self._beat_s - self._in_use.idle_s()
            if left_s > 0 or not self._arm.is_homed:
                await self._clock.sleep(left_s if left_s > 0 else self._beat_s / 4)
                continue
            try:
                await self._arm.read_opening_mm()
                odd_count = 0
            except DeviceError as error:
                odd_count += 1
                if odd_count < 2 and not isinstance(error, LinkError | PositionLostError):
                    log.warning("at rest: %s", error)
                    continue
                report(Event.FAULT, say("at rest: {error}", error=error), code_of(error))
                return


class ModbusWatcher:
    """Turns a fixed gripper or lamps that do not answer into a fault, once the policy ends.

    Parameters
    ----------
    gripper, lights : the devices
    retries : retries of a reading that does not come
    beat_s : period of readings [cell s]
    clock : clock of the cell
    """

    def __init__(
        self,
        gripper: FixedGripper,
        lights: LampUnit,
        retries: Retries,
        beat_s: float,
        clock: CellClock,
    ) -> None:
        self._gripper = gripper
        self._lights = lights
        self._retries = retries
        self._beat_s = beat_s
        self._clock = clock

    async def run(self, report: Report) -> None:
        """Watch until cancelled, or until a device is lost."""
        was_activated = False
        while True:
            await self._clock.sleep(self._beat_s)
            try:
                status = await self._retries.run(
                    "gripper", key("fixed gripper"), self._gripper.status
                )
                await self._retries.run("lights", "lights", self._lights.connect)
            except DeviceError as error:
                report(Event.FAULT, str(error), code_of(error))
                return
            if was_activated and not status.is_activated:
                report(
                    Event.FAULT,
                    key("fixed gripper: it has restarted and may have let go; check what it holds"),
                    "position_lost",
                )
                return
            was_activated = status.is_activated


class LoopWatcher:
    """Records delays of this process, in which it could have noticed nothing.

    A warning with a number, not a stop: devices are judged in attended time, which omits it.

    Parameters
    ----------
    record : gets the row
    limit_s : a delay above it is recorded [wall s]
    clock : clock of the cell
    attendance : measures; a loop with a time of its own is never late
    """

    def __init__(
        self,
        record: BatchRecord,
        limit_s: float,
        clock: CellClock,
        attendance: Callable[[], Attendance] = Attendance,
    ) -> None:
        self._record = record
        self._limit_s = limit_s
        self._clock = clock
        self._attendance = attendance

    async def run(self, report: Report) -> None:
        """Watch until cancelled."""
        if self._clock.monotonic is not time.monotonic:
            return
        while True:
            attendance = self._attendance()
            async with attendance.beating():
                await self._clock.sleep(LOOP_REPORT_S)
            if attendance.longest_s > self._limit_s:
                self._record.note(
                    LoopLate(
                        longest_s=round(attendance.longest_s, 3),
                        missed_s=round(attendance.lost_s(), 3),
                        within_s=LOOP_REPORT_S,
                        alarm=alarm_of("loop_late").number,
                    )
                )
