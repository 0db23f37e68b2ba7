"""One verb at a time on a device behind a line, in an order that a recording of the line keeps."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from ._link import ModbusLink


class VerbLock:
    """A lock for verbs of several requests.

    Requests take turns on the line, but which of two verbs has the device first is decided here,
    and by chance where both want it at once: a played recording has to decide as the recorded run
    did (ADR 46).

    Parameters
    ----------
    link : line of the device
    """

    def __init__(self, link: ModbusLink) -> None:
        self._link = link
        self._lock = asyncio.Lock()

    @asynccontextmanager
    async def held(self, verb: str) -> AsyncIterator[None]:
        """Have the device to oneself.

        Parameters
        ----------
        verb : its name, for the recording
        """
        tap, what = self._link.tap, f"verb {verb}"
        if tap is not None:
            await tap.turn(what)
        async with self._lock:
            if tap is not None:
                tap.taken(what)
            yield
