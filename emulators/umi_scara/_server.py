"""The arm's end of a pseudo-terminal: bytes between the kernel and the wire, in world time."""

import asyncio
import contextlib
import errno
import logging
import os
import pty
import tty
from pathlib import Path
from typing import Final

from emulators.clock import WorldClock

from ._wire import ArmWire

log = logging.getLogger(__name__)

READ_SIZE: Final = 4096
# The loop's timer rounds a wait up to whole milliseconds; half a millisecond early is as near as
# half late.
TIMER_GRAIN_WALL_S: Final = 0.0005


class ArmServer:
    """A serial line that any client may open, close and open again.

    Parameters
    ----------
    wire : device that answers
    clock : world time, by which the replies are paced
    link_path : path of a symbolic link to the terminal, so that its name is stable; a link left
        behind by a predecessor is replaced
    """

    def __init__(self, wire: ArmWire, clock: WorldClock, link_path: Path | None = None) -> None:
        self._wire = wire
        self._clock = clock
        self._link_path = link_path
        self._master_fd = -1
        self._slave_fd = -1
        self._slave_name = ""
        self._timer: asyncio.TimerHandle | None = None

    @property
    def path(self) -> Path:
        """The path of the line for a client; the terminal itself, behind any links.

        Raises
        ------
        ValueError : it has not been started
        """
        if not self._slave_name:
            raise ValueError("the arm's server has not been started")
        return Path(self._slave_name)

    async def start(self) -> None:
        """Open the terminal and begin to answer.

        Raises
        ------
        FileExistsError : ``link_path`` is something other than a symbolic link
        ValueError : it has been started already
        """
        if self._master_fd >= 0:
            raise ValueError("the arm's server runs already")
        # The slave end stays open here: a master whose last client leaves reads EIO for ever.
        self._master_fd, self._slave_fd = pty.openpty()
        try:
            tty.setraw(self._slave_fd)  # or the line discipline eats 0d, 03, 11 and 13
            os.set_blocking(self._master_fd, False)
            self._slave_name = os.ttyname(self._slave_fd)
            self._make_link()
        except BaseException:
            self._close()
            raise
        asyncio.get_running_loop().add_reader(self._master_fd, self._on_readable)

    async def aclose(self) -> None:
        """Close the terminal and take the link away; may be called twice."""
        if self._master_fd < 0:
            return
        asyncio.get_running_loop().remove_reader(self._master_fd)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._link_path is not None:
            with contextlib.suppress(OSError):  # taken by a successor, or not a link: not ours
                if os.readlink(self._link_path) == self._slave_name:  # noqa: PTH115 -- compares text
                    self._link_path.unlink()
        self._close()

    def _close(self) -> None:
        os.close(self._master_fd)
        os.close(self._slave_fd)
        self._master_fd = self._slave_fd = -1
        self._slave_name = ""

    def _make_link(self) -> None:
        if self._link_path is None:
            return
        if self._link_path.is_symlink():
            self._link_path.unlink()
        self._link_path.symlink_to(self._slave_name)

    def _on_readable(self) -> None:
        try:
            data = os.read(self._master_fd, READ_SIZE)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return
        self._wire.feed(data, self._clock.now_s())
        self._send_due()

    def _send_due(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        grain_s = TIMER_GRAIN_WALL_S * self._clock.speed
        data = self._wire.due(self._clock.now_s(), early_s=grain_s)
        if data:
            try:
                written = os.write(self._master_fd, data)
            except BlockingIOError:
                written = 0
            if written < len(data):  # as on a real line: nobody reads, the bytes are gone
                log.warning("arm: %d reply bytes lost, nobody reads the line", len(data) - written)
        due_s = self._wire.next_due_s()
        if due_s is not None:
            # time may stand still: look again, but after a pause
            wait_s = max(TIMER_GRAIN_WALL_S, (due_s - self._clock.now_s()) / self._clock.speed)
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._send_due)
