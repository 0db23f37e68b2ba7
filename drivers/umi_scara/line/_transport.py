"""The wire under the link: bytes over a serial line (umi_rtx.md 1.1), or over anything like it.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import errno
import os
import select
from typing import Protocol

import serial

from drivers.errors import LinkError, UnpluggedError
from messages import key, say

from ..protocol import constants as c


class Transport(Protocol):
    """Three methods, so that a test can be the other end."""

    def write(self, data: bytes) -> None:
        """Send all bytes in one call: a request split in two breaks the 8 ms rule (§8.17)."""

    async def read(self, timeout_wall_s: float) -> bytes:
        """Return the bytes received, after waiting [wall s] for a first one; b"" if none came.

        A timeout of 0 returns what is there already. A cancelled read loses no byte.
        """

    async def aclose(self) -> None:
        """Release the line."""


_GONE = frozenset({errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF, errno.EPIPE})


class SerialTransport:
    """A serial port: 9600 8N1, no flow control, DTR and RTS asserted, exclusive (§1.1).

    The event loop watches the descriptor; no thread is involved. Create it inside the loop.

    Parameters
    ----------
    port : device node, such as /dev/ttyUSB0
    rtscts : hardware flow control, for a cable that needs it (§1.1)

    Raises
    ------
    LinkError : the port is missing, may not be opened, or is in use by another program
    """

    def __init__(self, port: str, *, rtscts: bool = False) -> None:
        self._port = port
        self._buffer = bytearray()
        self._arrived = asyncio.Event()
        self._failure: UnpluggedError | None = None
        self._loop = asyncio.get_running_loop()
        try:
            self._serial = serial.Serial(
                port, c.BAUD, timeout=0, write_timeout=0, rtscts=rtscts, exclusive=True
            )
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise LinkError(
                say("arm: cannot open {port}: {error}", port=port, error=error)
            ) from error
        self._fd: int = self._serial.fileno()
        self._loop.add_reader(self._fd, self._on_readable)

    def _on_readable(self) -> None:
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return
        except OSError as error:
            self._fail(str(error))
            return
        if data:
            self._buffer += data
            self._arrived.set()
        elif self._has_hung_up():
            self._fail(key("the line hung up"))

    def _has_hung_up(self) -> bool:
        """Return whether a read without data means that the other end is gone.

        A line with VMIN and VTIME 0 also reads as empty where another read has just taken
        the bytes.
        """
        poll = select.poll()
        poll.register(self._fd, 0)  # hang-up and error are always reported
        return bool(poll.poll(0))

    def _fail(self, why: str) -> None:
        self._failure = UnpluggedError(say("arm: {port} is gone: {why}", port=self._port, why=why))
        self._loop.remove_reader(self._fd)  # a dead descriptor stays readable and would spin
        self._arrived.set()

    def write(self, data: bytes) -> None:
        """Send all bytes in one call.

        Raises
        ------
        UnpluggedError : the port is gone
        LinkError : the port does not take the bytes
        """
        if self._failure is not None:
            raise self._failure
        try:
            sent_count = os.write(self._fd, data)
        except BlockingIOError as error:
            raise LinkError(say("arm: {port} takes no bytes", port=self._port)) from error
        except OSError as error:
            if error.errno in _GONE:
                self._fail(str(error))
                raise UnpluggedError(
                    say("arm: {port} is gone: {error}", port=self._port, error=error)
                ) from error
            raise LinkError(
                say("arm: cannot write to {port}: {error}", port=self._port, error=error)
            ) from error
        if sent_count != len(data):
            raise LinkError(
                say(
                    "arm: {port} took {sent_count} of {data_count} bytes",
                    port=self._port,
                    sent_count=sent_count,
                    data_count=len(data),
                )
            )

    async def read(self, timeout_wall_s: float) -> bytes:
        """Return the bytes received, after waiting [wall s] for a first one; b"" if none came.

        Raises
        ------
        UnpluggedError : the port is gone
        """
        if not self._buffer and self._failure is None:
            if timeout_wall_s <= 0:
                await asyncio.sleep(0)  # lets the loop deliver what the kernel holds
                self._poll_kernel()
            else:
                try:
                    async with asyncio.timeout(timeout_wall_s):
                        await self._arrived.wait()
                except TimeoutError:
                    return b""
        data = bytes(self._buffer)
        self._buffer.clear()
        self._arrived.clear()
        if not data and self._failure is not None:
            raise self._failure
        return data

    def _poll_kernel(self) -> None:
        try:
            if self._failure is None and self._serial.in_waiting:
                self._on_readable()
        except OSError as error:
            self._fail(str(error))

    async def aclose(self) -> None:
        """Release the line; a second call does nothing."""
        if self._serial.is_open:
            self._loop.remove_reader(self._fd)
            self._serial.close()
            self._failure = UnpluggedError(say("arm: {port} is closed", port=self._port))
            self._arrived.set()
