"""A TCP connection to the controller: opened in time, closed without waiting."""

import asyncio
import logging
from contextlib import suppress
from typing import Final

from drivers.clock import CellClock
from drivers.errors import LinkError, UnpluggedError
from messages import say

wire_log = logging.getLogger("cellctl.wire.arm")

CONNECT_WALL_S: Final = 2.0  # a controller on the same network answers in milliseconds
_CHUNK: Final = 1 << 16


class Stream:
    """An open connection."""

    def __init__(
        self, what: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._what = what
        self._reader, self._writer = reader, writer

    def write(self, data: bytes) -> None:
        """Send bytes, ahead of nothing else: what was sent before is on its way already.

        Raises
        ------
        UnpluggedError : the connection is gone
        """
        if self._writer.is_closing():
            raise UnpluggedError(say("arm: {what}: the connection is gone", what=self._what))
        wire_log.debug("%s > %r", self._what, data)
        self._writer.write(data)

    async def read(self) -> bytes:
        """Return the bytes that have come, at least one.

        Raises
        ------
        UnpluggedError : the connection has ended
        """
        try:
            data = await self._reader.read(_CHUNK)
        except OSError as error:
            raise UnpluggedError(
                say("arm: {what}: the connection is gone ({error})", what=self._what, error=error)
            ) from error
        if not data:
            raise UnpluggedError(
                say("arm: {what}: the controller has closed the connection", what=self._what)
            )
        return data

    async def aclose(self) -> None:
        """Close it, without waiting for data written."""
        self._writer.close()
        with suppress(OSError, TimeoutError):
            async with asyncio.timeout(CONNECT_WALL_S):
                await self._writer.wait_closed()


async def open_stream(what: str, host: str, port: int, clock: CellClock) -> Stream:
    """Return a connection to a port of the controller.

    Parameters
    ----------
    what : the port in words, for messages
    host, port : where it is
    clock : the cell's clock

    Raises
    ------
    LinkError : nobody answers there
    """
    try:
        # opening is the host's business: it is no faster where cell time is
        async with clock.timeout(CONNECT_WALL_S * clock.speed):
            reader, writer = await asyncio.open_connection(host, port)
    except (OSError, TimeoutError) as error:
        reason = str(error) or "no answer"
        raise LinkError(
            say(
                "arm: no {what} at {host}:{port} ({reason}); check the cable, the "
                "controller's address, and that its service is enabled in the "
                "security settings",
                what=what,
                host=host,
                port=port,
                reason=reason,
            )
        ) from error
    return Stream(what, reader, writer)
