"""Holding, stopping, aborting, clearing: come to rest, and leave rest. No gripper opens."""

import logging
from contextlib import suppress
from dataclasses import dataclass

from controller.cell.alarms import alarm_of
from controller.cell.devices.interlocks import check_interlocks
from controller.cell.devices.stopping import Stopping
from controller.cell.journal import Journal, JournalError
from controller.cell.journal.rows import StopNotConfirmed, Stopped
from controller.cell.machine import Event
from drivers.kinds import IoBlock, Stop

from ..services import Views

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class HoldAction:
    """Stops the arm; grippers keep their grasp.

    Attributes
    ----------
    stopping : stops devices and waits until they confirm it
    views : views of the part; those still being judged are dropped
    """

    stopping: Stopping
    views: Views

    async def run(self) -> Event:
        """Stop the arm on a ramp; return ``HOLD_DONE``."""
        self.views.drop_pending()
        await self.stopping.stop_arm(Stop.RAMP)
        return Event.HOLD_DONE


@dataclass(frozen=True, slots=True, eq=False)
class StopMotionAction:
    """Stops every device on request.

    Attributes
    ----------
    stopping : stops devices and waits until they confirm it
    views : views of the part; those still being judged are dropped
    """

    stopping: Stopping
    views: Views

    async def run(self) -> Event:
        """Stop every device; return ``STOP_DONE``, or raise the error of the first unconfirmed."""
        self.views.drop_pending()
        failures = await self.stopping.stop_all(Stop.RAMP)
        for error in failures.values():
            raise error
        return Event.STOP_DONE


@dataclass(frozen=True, slots=True, eq=False)
class AbortMotionAction:
    """Stops at once every device that still answers.

    Attributes
    ----------
    stopping : stops the devices
    views : views of the part; those still being judged are dropped
    journal : journal for the devices stopped, and those that did not stop
    """

    stopping: Stopping
    views: Views
    journal: Journal

    async def run(self) -> Event:
        """Stop every device, journal the confirmations; return ``ABORT_DONE``."""
        self.views.drop_pending()
        failures = await self.stopping.stop_all(Stop.DEAD)
        for name in self.stopping.names:
            error = failures.get(name)
            if error is None:
                self.journal.write(Stopped(device=name))
                continue
            number = alarm_of("stop_not_confirmed").number
            log.warning("%s did not confirm the stop: %s", name, error)
            with suppress(JournalError):
                self.journal.write(StopNotConfirmed(device=name, error=str(error), alarm=number))
        return Event.ABORT_DONE


@dataclass(frozen=True, slots=True, eq=False)
class ClearFaultAction:
    """Checks that the cause of the stop is gone.

    Attributes
    ----------
    io : the interlocks
    """

    io: IoBlock

    async def run(self) -> Event:
        """Check the interlocks; return ``CLEAR_DONE``.

        Raises
        ------
        InterlockError : one is still not healthy
        """
        check_interlocks(self.io)
        return Event.CLEAR_DONE
