"""Watchers of interlocks, a part that leaves the fixed gripper, and the disk."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import FixedGripper, Hold, IoBlock, MotorWatchdog
from messages import say

from ...custody import Custody
from ...devices.interlocks import Truth
from ...errors import PartProblemError, PolicyAbortError
from ...machine import Event
from ...services import Grippers, Interlocks, Recoveries
from ...services.records import BatchRecord

ACKNOWLEDGE = "acknowledge"  # the input of the button
LOSS_POLL_S = 0.5
DISK_POLL_S = 10.0
# Below this a run is stopped while its journal can still say so; a row takes some kilobytes, the
# pictures of a view take about 4 MB.
MIN_DISK_BYTES = 30_000_000


class Report(Protocol):
    """Takes an event, with a message and a code for the operator."""

    def __call__(self, event: Event, message: str = "", code: str = "") -> None:
        """Take it."""
        ...


class BatchWatcher(Protocol):
    """Watches something from the start of a batch to its end."""

    async def run(self, report: Report) -> None:
        """Watch until cancelled."""
        ...


class InterlockWatcher:
    """Reports a violated interlock rule at once: as a fault, or as a hold of the run.

    The acknowledge button of the I/O block counts as a person's word, as `cellctl ack` does.

    Parameters
    ----------
    io : reports changes of its signals
    interlocks : the rules
    """

    def __init__(self, io: IoBlock, interlocks: Interlocks) -> None:
        self._io = io
        self._interlocks = interlocks

    async def run(self, report: Report) -> None:
        """Watch until cancelled."""
        with self._io.watch() as changes:
            async for change in changes:
                if change.name == ACKNOWLEDGE and change.signal.is_ok:
                    report(Event.ACKNOWLEDGE)
                # a change may be over again by now, and stops the cell all the same
                violation = self._interlocks.violation(
                    {change.name: Truth.of_signal(change.signal)}
                )
                if violation is not None:
                    event = Event.GUARD_OPENED if violation.rule.holds else Event.FAULT
                    report(event, violation.message, violation.code)


class MotorSupplyWatcher:
    """Turns a trip of the I/O block's watchdog, which has stopped the motors, into a fault.

    Parameters
    ----------
    io : the I/O block; one without such a watchdog is never reported
    """

    def __init__(self, io: IoBlock) -> None:
        self._io = io

    async def run(self, report: Report) -> None:
        """Watch until it has tripped, or until cancelled."""
        if not isinstance(self._io, MotorWatchdog) or self._io.watchdog_s is None:
            return
        await self._io.wait_tripped()
        report(
            Event.FAULT,
            say(
                "the I/O block received nothing for {watchdog_s:g} s, so its "
                "watchdog cut the motors' supply; find out why this computer "
                "stalled, then start again",
                watchdog_s=self._io.watchdog_s,
            ),
            "motor_watchdog",
        )


class DiskWatcher:
    """Stops the run before the disk is full: a full disk cannot record the stop.

    Parameters
    ----------
    folder : watched folder, on the disk
    clock : clock of the cell
    free_bytes : function that returns the free space on a folder's disk
    """

    def __init__(
        self,
        folder: Path,
        clock: CellClock,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        self._folder = folder
        self._clock = clock
        self._free_bytes = free_bytes

    async def run(self, report: Report) -> None:
        """Watch until the disk is nearly full, or until cancelled."""
        while (free := self._free_bytes(self._folder)) >= MIN_DISK_BYTES:
            await self._clock.sleep(DISK_POLL_S)
        report(
            Event.STOP,
            say(
                "the disk of {folder} has {free_mb:.0f} MB left: the run was stopped "
                "while that can still be recorded. Make room, then start again",
                folder=self._folder,
                free_mb=free / 1e6,
            ),
            "disk_full",
        )


class FixedGripperWatcher:
    """Turns a part that leaves the fixed gripper into an event, at once.

    Parameters
    ----------
    gripper : the device
    grippers, recoveries, record : services
    clock : clock of the cell
    """

    def __init__(
        self,
        gripper: FixedGripper,
        grippers: Grippers,
        recoveries: Recoveries,
        record: BatchRecord,
        clock: CellClock,
    ) -> None:
        self._gripper = gripper
        self._grippers = grippers
        self._recoveries = recoveries
        self._record = record
        self._clock = clock

    async def run(self, report: Report) -> None:
        """Watch until cancelled."""
        while True:
            await self._gripper.wait_lost()
            try:
                is_lost = await self._book_loss()
            except PartProblemError as problem:
                report(Event.PART_PROBLEM, str(problem), problem.code)
                is_lost = False
            except PolicyAbortError as error:
                report(Event.FAULT, str(error), error.code)
                return
            if is_lost:
                report(Event.PART_DROPPED)
            # the gripper reports the loss until its jaws are moved again
            with suppress(DeviceError):
                while (await self._gripper.hold()) is Hold.LOST:
                    await self._clock.sleep(LOSS_POLL_S)
            await self._clock.sleep(LOSS_POLL_S)

    async def _book_loss(self) -> bool:
        """Record a loss if the fixed gripper alone had the part; return whether it had.

        If the arm gripper has it as well, the arm gripper's own check decides.
        """
        if self._record.part.custody is not Custody.IN_FIXED:
            return False
        self._recoveries.book(await self._grippers.lose_from_fixed())
        return True
