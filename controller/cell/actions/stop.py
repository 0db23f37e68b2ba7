"""Holding, stopping, aborting, clearing: the cell comes to rest and leaves it; no jaw opens."""

import logging
from contextlib import suppress

from drivers.kinds import IoBlock, Stop

from ..interlocks import check_interlocks
from ..journal import Journal, JournalError
from ..journal.rows import StopNotConfirmed, Stopped
from ..machine import Event
from ..services import Views
from ..stopping import Stopping

log = logging.getLogger(__name__)


class HoldAction:
    """Stands still and keeps holding."""

    def __init__(self, stopping: Stopping, views: Views) -> None:
        self._stopping = stopping
        self._views = views

    async def run(self) -> Event:
        """Stop the arm on a ramp."""
        self._views.drop_pending()
        await self._stopping.stop_arm(Stop.RAMP)
        return Event.HOLD_DONE


class StopMotionAction:
    """Stops on request."""

    def __init__(self, stopping: Stopping, views: Views) -> None:
        self._stopping = stopping
        self._views = views

    async def run(self) -> Event:
        """Stop every device; raise what the first one raised that did not confirm."""
        self._views.drop_pending()
        failures = await self._stopping.stop_all(Stop.RAMP)
        for error in failures.values():
            raise error
        return Event.STOP_DONE


class AbortMotionAction:
    """Stops at once whatever still answers.

    Parameters
    ----------
    stopping : stops the devices
    views : the views of the part; those still being judged are given up
    journal : gets what stopped and what did not answer
    """

    def __init__(self, stopping: Stopping, views: Views, journal: Journal) -> None:
        self._stopping = stopping
        self._views = views
        self._journal = journal

    async def run(self) -> Event:
        """Stop every device; write down which confirmed it."""
        self._views.drop_pending()
        failures = await self._stopping.stop_all(Stop.DEAD)
        for name in self._stopping.names:
            error = failures.get(name)
            if error is None:
                self._journal.write(Stopped(device=name))
                continue
            log.warning("%s did not confirm the stop: %s", name, error)
            with suppress(JournalError):
                self._journal.write(StopNotConfirmed(device=name, error=str(error)))
        return Event.ABORT_DONE


class ClearFaultAction:
    """Checks that what stopped the cell is gone."""

    def __init__(self, io: IoBlock) -> None:
        self._io = io

    async def run(self) -> Event:
        """Check the interlocks.

        Raises
        ------
        InterlockError : one is still not healthy
        """
        check_interlocks(self._io)
        return Event.CLEAR_DONE
