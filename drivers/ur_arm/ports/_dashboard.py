"""The dashboard: power, brakes, modes; one line of text for another (§3).

Sections (§) are those of ur.md.
"""

import asyncio
import re
from typing import Final

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    RefusedError,
    ReplyTimeoutError,
    WrongDeviceError,
)
from messages import say

from ._stream import Stream, open_stream

__all__ = ["Dashboard"]

REPLY_S: Final = 2.0  # `power on` is answered when it has begun [cell s]
GREETING: Final = "Universal Robots Dashboard Server"
UNKNOWN: Final = "could not understand"  # §3.1
MAX_LINE: Final = 4096


class Dashboard:
    """The connection to port 29999; one request at a time.

    A request that was cancelled, or not answered in time, leaves an answer behind: the next one has
    a connection of its own.

    Parameters
    ----------
    host, port : where it is
    clock : the cell's clock
    """

    def __init__(self, host: str, port: int, clock: CellClock) -> None:
        self._host, self._port, self._clock = host, port, clock
        self._stream: Stream | None = None
        self._data = b""
        self._one = asyncio.Lock()

    async def open(self) -> None:
        """Connect, and be greeted.

        Raises
        ------
        LinkError : nobody answers there
        WrongDeviceError : something else answers
        """
        await self.aclose()
        self._stream = await open_stream("dashboard", self._host, self._port, self._clock)
        self._data = b""
        try:
            greeting = await self._line("a greeting")
            if GREETING not in greeting:
                raise WrongDeviceError(
                    say(
                        "arm: {host}:{port} greets with {greeting}, not as the dashboard "
                        "of a Universal Robots controller",
                        host=self._host,
                        port=self._port,
                        greeting=repr(greeting[:60]),
                    )
                )
        except BaseException:
            await self.aclose()
            raise

    async def ask(self, line: str) -> str:
        """Return the answer to a line; empty where the controller does not know it.

        Raises
        ------
        ReplyTimeoutError : no answer; what was ordered is done or not
        """
        async with self._one:
            if self._stream is None:
                await self.open()
            assert self._stream is not None, "just opened"
            try:
                self._stream.write(f"{line}\n".encode())
                answer = await self._line(f"`{line}`")
            except BaseException:
                await self.aclose()
                raise
        return "" if answer.lower().startswith(UNKNOWN) else answer

    async def order(self, line: str, accepted: str) -> None:
        """Order something.

        Parameters
        ----------
        line : order
        accepted : pattern of the answer that accepts it

        Raises
        ------
        RefusedError : any other answer; the message has it
        """
        answer = await self.ask(line)
        if re.match(accepted, answer, re.IGNORECASE) is None:
            raise RefusedError(
                say(
                    "arm: `{line}` was refused: {answer}",
                    line=line,
                    answer=answer or "not understood",
                ),
                0,
            )

    async def _line(self, what: str) -> str:
        assert self._stream is not None, "open"
        try:
            async with self._clock.timeout(REPLY_S):
                while b"\n" not in self._data:
                    if len(self._data) > MAX_LINE:
                        raise BadReplyError(
                            say(
                                "arm: dashboard: no end of line: {data}", data=repr(self._data[:40])
                            )
                        )
                    self._data += await self._stream.read()
        except TimeoutError as error:
            raise ReplyTimeoutError(
                say("arm: dashboard: no answer to {what}", what=what)
            ) from error
        line, _, self._data = self._data.partition(b"\n")
        return line.decode("utf-8", "replace").strip()

    async def aclose(self) -> None:
        """End the connection."""
        stream, self._stream = self._stream, None
        if stream is not None:
            await stream.aclose()
