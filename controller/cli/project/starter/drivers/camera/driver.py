"""Driver of the ACME camera over TCP: frames exposed after an instant.

The camera is invented. Its wire is lines of text (manual, section 2): `ID` is answered with
`ACME width height`; `SNAP microseconds` starts an exposure and is answered with `FRAME bytes` and
so many grey levels. Put your camera's wire in place of `_Line`, and keep the verbs.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    LinkError,
    ReplyTimeoutError,
    UnpluggedError,
    WrongDeviceError,
)
from drivers.kinds import Camera, Capture, Driver, NoSettings, Site

REPLY_S: Final = 1.0  # manual, 2.1
WHITE: Final = 255  # manual, 2.3


@dataclass(frozen=True, slots=True, eq=False)
class AcmeFrame:
    """One picture.

    Attributes
    ----------
    image : (height, width) grey levels
    white : the largest value of a pixel
    earliest_light_s : instant of the cell's clock before which no light was gathered [s]
    timestamp_s : instant at which the whole picture was there [s]
    """

    image: NDArray[np.uint8]
    white: int
    earliest_light_s: float
    timestamp_s: float


class AcmeCamera:
    """One camera; a frame is exposed by a trigger, so no clock but the cell's is needed.

    Parameters
    ----------
    name : in messages
    host, port : where it is
    capture : of the cell file
    clock : the cell's clock
    """

    model = "ACME camera"

    def __init__(self, name: str, host: str, port: int, capture: Capture, clock: CellClock) -> None:
        self._name = name
        self._capture = capture
        self._clock = clock
        self._line = _Line(name, host, port, clock)
        self._is_open = False
        self._is_paused = False
        self._look = asyncio.Lock()  # one exposure at a time

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of its pictures [px]."""
        return self._capture.height, self._capture.width

    @property
    def is_paused(self) -> bool:
        """Whether no frames are taken."""
        return self._is_paused

    async def connect(self) -> str:
        """Open the line and check what answers; return its words.

        Raises
        ------
        WrongDeviceError : it is no such camera, or its pictures have another size
        """
        await self._line.aclose()
        found = (await self._line.ask("ID", REPLY_S)).split()
        wanted = ["ACME", str(self._capture.width), str(self._capture.height)]
        if found != wanted:
            raise WrongDeviceError(
                f"{self._name}: expected `{' '.join(wanted)}`, found `{' '.join(found)}`; check "
                "the address, and `size_px` of the cell file"
            )
        self._is_open, self._is_paused = True, False
        return " ".join(found)

    async def pause(self) -> None:
        """Take no frames until `resume`."""
        self._is_paused = True

    async def resume(self) -> None:
        """Take frames again."""
        self._is_paused = False

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> AcmeFrame:
        """Return a frame exposed wholly after an instant of the cell's clock [s].

        Raises
        ------
        ValueError : it is paused
        ReplyTimeoutError : no frame came in time
        LinkError : the camera is gone
        """
        if self._is_paused:
            raise ValueError(f"{self._name}: is paused")
        capture = self._capture
        usual_s = 2.0 / capture.fps + capture.exposure_s + capture.frame_late_s
        patience_s = usual_s + max(0.0, t_s - self._clock.now_s())
        try:
            async with (
                self._clock.timeout(patience_s if timeout_s is None else timeout_s),
                self._look,
            ):
                await self._clock.sleep(t_s - self._clock.now_s())
                return await self._exposed(usual_s)
        except TimeoutError as error:
            raise ReplyTimeoutError(
                f"{self._name}: no frame in time; check its power and its cable"
            ) from error

    async def close(self) -> None:
        """Close the line; a wait for a frame ends with `LinkError`."""
        self._is_open = False
        await self._line.aclose()

    async def _exposed(self, usual_s: float) -> AcmeFrame:
        if not self._is_open:
            raise LinkError(f"{self._name}: not connected")
        triggered_s = self._clock.now_s()
        head = await self._line.ask(f"SNAP {1e6 * self._capture.exposure_s:.0f}", usual_s)
        word, _, count = head.partition(" ")
        height, width = self.shape
        if word != "FRAME" or count != str(height * width):
            await self._line.aclose()  # what else is on its way cannot be told from an answer
            raise BadReplyError(f"{self._name}: `SNAP` was answered with `{head:.40}`")
        grey = np.frombuffer(await self._line.take(height * width, usual_s), np.uint8)
        return AcmeFrame(grey.reshape(height, width), WHITE, triggered_s, self._clock.now_s())


class _Line:
    """A TCP connection with one question in flight; opened when it is needed.

    A question that was cancelled or not answered ends the connection: a late answer must not be
    taken for the next one's.
    """

    def __init__(self, name: str, host: str, port: int, clock: CellClock) -> None:
        self._name, self._host, self._port, self._clock = name, host, port, clock
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def ask(self, words: str, reply_s: float) -> str:
        """Send a line; return the line that answers it."""

        async def exchange(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
            writer.write(f"{words}\n".encode())
            return await reader.readuntil(b"\n")

        answer = await self._use(exchange, words, reply_s)
        return answer.decode("ascii", "replace").strip()

    async def take(self, count: int, reply_s: float) -> bytes:
        """Return so many bytes that follow an answer."""

        async def exchange(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> bytes:
            return await reader.readexactly(count)

        return await self._use(exchange, f"{count} bytes", reply_s)

    async def aclose(self) -> None:
        """End the connection."""
        if self._streams is not None:
            self._streams[1].transport.abort()
            self._streams = None

    async def _use(self, exchange: "_Exchange", what: str, reply_s: float) -> bytes:
        is_done = False
        try:
            async with self._clock.timeout(reply_s):
                if self._streams is None:
                    self._streams = await asyncio.open_connection(self._host, self._port)
                answer = await exchange(*self._streams)
            is_done = True
        except TimeoutError as error:
            raise ReplyTimeoutError(f"{self._name}: no answer to `{what}`") from error
        except (OSError, asyncio.IncompleteReadError) as error:
            raise UnpluggedError(f"{self._name}: {self._host}:{self._port}: {error}") from error
        except asyncio.LimitOverrunError as error:
            raise BadReplyError(f"{self._name}: `{what}`: a line without an end") from error
        finally:
            if not is_done:
                await self.aclose()
        return answer


_Exchange = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[bytes]]


def _build(site: Site, settings: NoSettings) -> AcmeCamera:
    """Return the camera of a cell file; opens nothing yet."""
    del settings
    assert site.capture is not None  # every camera of a cell file has one
    host, _, port = site.address.rpartition(":")
    return AcmeCamera(site.name, host, int(port), site.capture, site.clock)


DRIVER: Driver[Camera, NoSettings] = Driver(NoSettings, _build)
