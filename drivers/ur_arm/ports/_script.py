"""The script port: lines to run, and what the controller says of those that it refuses (§4).

Sections (§) are those of ur.md.
"""

import asyncio
import logging
from collections import deque
from contextlib import suppress
from typing import Final

from drivers.clock import CellClock
from drivers.errors import LinkError, UnpluggedError
from messages import key

from ..protocol import MessageReader
from ._stream import Stream, open_stream

__all__ = ["ScriptPort"]

log = logging.getLogger(__name__)

TEXT_COUNT: Final = 8  # messages kept


class ScriptPort:
    """The connection to port 30001. What arrives is read in a task, so that it never stops."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._reader = MessageReader()
        self.texts: deque[str] = deque(maxlen=TEXT_COUNT)
        self._task = asyncio.create_task(self._run(), name="arm messages")

    @classmethod
    async def open(cls, host: str, port: int, clock: CellClock) -> "ScriptPort":
        """Return the port.

        Parameters
        ----------
        host, port : where it is
        clock : the cell's clock

        Raises
        ------
        LinkError : nobody answers there
        """
        return cls(await open_stream("script port", host, port, clock))

    @property
    def is_open(self) -> bool:
        """Whether the controller has not ended the connection."""
        return not self._task.done()

    def send(self, line: bytes) -> None:
        """Send a line; it ends the program that runs.

        Raises
        ------
        UnpluggedError : the connection is gone
        """
        if not self.is_open:
            raise UnpluggedError(key("arm: script port: the controller has closed the connection"))
        self._stream.write(line)

    async def _run(self) -> None:
        with suppress(LinkError):  # found again by whoever sends, and by the states
            while True:
                for text in self._reader.feed(await self._stream.read()):
                    log.info("arm: %s", text)
                    self.texts.append(text)

    async def aclose(self) -> None:
        """End the task and the connection."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        await self._stream.aclose()
