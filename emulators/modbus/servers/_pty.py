"""Modbus RTU on a pseudo-terminal: the emulated end of a serial cable."""

import asyncio
import contextlib
import os
import tty
from pathlib import Path

from emulators.clock import WorldClock

from ..bus import Bus
from ._rtu_line import DEFAULT_TURNAROUND_S, HangUp, RtuLine


class _PtyPlug:
    def __init__(self, master_fd: int) -> None:
        self.reader = asyncio.StreamReader()
        self._fd = master_fd

    def feed(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self.reader.feed_data(os.read(self._fd, 4096))

    def write(self, data: bytes) -> None:
        # when nobody reads, the terminal's queue fills up; a UART does not wait for readers
        with contextlib.suppress(BlockingIOError):
            os.write(self._fd, data)


class RtuPtyServer:
    """A bus on a raw pseudo-terminal.

    The slave end stays open here: otherwise the first client to leave would end the line.
    """

    def __init__(
        self,
        bus: Bus,
        clock: WorldClock,
        baudrate: int = 115200,
        *,
        turnaround_s: float = DEFAULT_TURNAROUND_S,
        link: Path | None = None,
    ) -> None:
        """Make a server; `start` opens it.

        Parameters
        ----------
        bus : the devices on the line
        clock : the world's clock
        baudrate : baudrate of the line, 8N1; a pseudo-terminal has none of its own [bit/s]
        turnaround_s : from the end of a request to the start of the reply [world s]
        link : a symbolic link to keep at the terminal, so that its name survives a restart
        """
        self.bus = bus
        self._line = RtuLine(bus, clock, baudrate, turnaround_s)
        self._link = link
        self._fds: tuple[int, int] | None = None
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Open the terminal.

        Raises
        ------
        ValueError : it has been started already
        """
        if self._fds is not None:
            raise ValueError("started already")
        master_fd, slave_fd = os.openpty()
        tty.setraw(slave_fd)
        os.set_blocking(master_fd, False)
        self._fds = master_fd, slave_fd
        plug = _PtyPlug(master_fd)
        loop = asyncio.get_running_loop()
        loop.add_reader(master_fd, plug.feed)
        self._task = loop.create_task(self._serve(plug))
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(os.ttyname(slave_fd))

    @property
    def path(self) -> str:
        """The terminal that a client opens.

        Raises
        ------
        ValueError : it has not been started
        """
        if self._fds is None:
            raise ValueError("not started")
        return os.ttyname(self._fds[1]) if self._link is None else str(self._link)

    async def aclose(self) -> None:
        """Close the terminal; a client that has it open sees its cable pulled."""
        if self._fds is None or self._task is None:
            return
        master_fd, slave_fd = self._fds
        self._fds = None
        asyncio.get_running_loop().remove_reader(master_fd)
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self._task = None
        os.close(master_fd)
        os.close(slave_fd)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    async def _serve(self, plug: _PtyPlug) -> None:
        while True:
            # a serial cable has no connection to drop: the reply is missing, the line goes on
            with contextlib.suppress(HangUp):
                await self._line.serve(plug)
