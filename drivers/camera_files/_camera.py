"""A camera with existing pictures, shown by the cell's clock."""

import asyncio
import math
import struct
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Final, ParamSpec, Self, TypeVar

import numpy as np

from drivers.clock import REAL_TIME, CellClock
from drivers.errors import BadReplyError, LinkError, ReplyTimeoutError, UnpluggedError
from drivers.wires import UNTAPPED, Wires
from messages import key, say

from ._sources import Image, Source

_P = ParamSpec("_P")
_R = TypeVar("_R")

_HEAD: Final = struct.Struct("<III")  # height, width, bytes a pixel; as it is recorded
_NUMBER: Final = struct.Struct("<I")


@dataclass(frozen=True, slots=True, eq=False)
class FileFrame:
    """One picture, and the time at which it was shown.

    Attributes
    ----------
    image : (height, width) uint8 or uint16, read-only
    white : the largest value a pixel can have
    timestamp_s : the end of what stands for its exposure [cell s]
    earliest_light_s : the begin of that; when its light was really gathered nobody knows [cell s]
    number : number of the picture in its folder or video, from 0
    """

    image: Image
    white: int
    timestamp_s: float
    earliest_light_s: float
    number: int


class FileCamera:
    """Pictures from files, in place of a camera's view.

    It exposes at the cell file's rate and for its exposure, as far as the clock is concerned: no
    frame is there before a camera could have had it.

    Parameters
    ----------
    source : source of the pictures
    name : name of the camera
    period_s : from one frame to the next [cell s]
    exposure_s : substitute for an exposure time [cell s]
    late_s : a frame may come this much later than rate and exposure explain [cell s]
    loops : begins anew behind the last picture; else it is gone, as if it were unplugged
    passes : pictures pass by the clock; else each look takes the next one
    clock : the cell's clock
    wires : recorder or player of the pictures
    """

    def __init__(
        self,
        source: Source,
        *,
        name: str,
        period_s: float,
        exposure_s: float,
        late_s: float,
        loops: bool = False,
        passes: bool = False,
        clock: CellClock = REAL_TIME,
        wires: Wires = UNTAPPED,
    ) -> None:
        self._source, self._name = source, name
        self._period_s, self._exposure_s, self._late_s = period_s, exposure_s, late_s
        self._loops, self._passes = loops, passes
        self._clock = clock
        self._wires, self._tap = wires, wires.camera(name)
        self._lock = asyncio.Lock()
        self._worker: Executor | None = None
        self._closing: asyncio.Future[None] | None = None
        self._shape: tuple[int, int] | None = None
        self._words = key("pictures from files")
        self._is_paused = False
        self._begun_s: float | None = None  # of the first frame ever; pictures pass from here on
        self._running_s = 0.0  # since when frames come
        self._frame_count = 0  # frames shown: the next one is later than all of them
        self._next = 0  # number of the next picture, where each look takes one
        self._count: int | None = None  # of all pictures, once the end was seen

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def connect(self) -> str:
        """Check the pictures and begin to show them from the last position; return a description.

        Raises
        ------
        NoPictureError : no pictures, or not of this camera's size and format
        LinkError : all pictures have been shown, and it does not begin anew
        ValueError : it is connected already
        """
        async with self._lock:
            if self._shape is not None:
                raise ValueError(f"{self._name}: already connected")
            if self._count is not None and not self._loops:
                raise LinkError(self._at_end())
            self._worker = self._wires.thread(self._name)
            try:
                answer = await self._call("open", b"", self._open)
                image, words = _unpacked(answer), answer[_end_of(answer) :].decode()
            except BaseException:
                await self._tear_down()
                raise
            self._shape = (image.shape[0], image.shape[1])
            self._words, self._is_paused = words, False
            self._closing = asyncio.get_running_loop().create_future()
            self._running_s = self._clock.now_s()
            if self._begun_s is None:
                self._begun_s = self._running_s
            return words

    async def close(self) -> None:
        """Release the files; a wait in progress ends with ``LinkError``."""
        if self._closing is not None and not self._closing.done():
            self._closing.set_result(None)
        async with self._lock:
            await self._tear_down()

    @property
    def model(self) -> str:
        """The device's name in messages and the journal."""
        return self._words

    @property
    def is_paused(self) -> bool:
        """Whether no frames are shown."""
        return self._is_paused

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of its pictures [px].

        Raises
        ------
        LinkError : it is not connected
        """
        if self._shape is None:
            raise LinkError(say("{name}: not connected", name=self._name))
        return self._shape

    async def pause(self) -> None:
        """Deliver no frames; pictures that pass by the clock go on passing."""
        async with self._lock:
            self._is_paused = self.shape is not None

    async def resume(self) -> None:
        """Deliver frames again."""
        async with self._lock:
            if self.shape and self._is_paused:
                self._is_paused, self._running_s = False, self._clock.now_s()

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> FileFrame:
        """Return the first frame that begins after an instant.

        Parameters
        ----------
        t_s : instant on the clock's scale [cell s]
        timeout_s : patience from now on [cell s]; by default until then, a frame's time, and the
            configured lateness

        Raises
        ------
        ReplyTimeoutError : there is no such frame in time
        UnpluggedError : all pictures have been shown; it is closed
        NoPictureError : a picture is gone, or is not what it was
        ValueError : it is paused
        """
        async with self._lock:
            if self.shape and self._is_paused:
                raise ValueError(f"{self._name}: paused; resume it first")
            frame, start_s = self._first_frame(t_s)
            now_s, ready_s = self._clock.now_s(), start_s + self._exposure_s
            if timeout_s is None:
                timeout_s = max(0.0, ready_s - now_s) + self._late_s
            try:
                async with self._clock.timeout(timeout_s):
                    await self._wait(ready_s - now_s)
                    number = frame if self._passes else self._next
                    image, number = await self._picture(number)
            except TimeoutError as error:
                raise ReplyTimeoutError(
                    say(
                        "{name}: no frame begun after {t_s:.3f} s within {timeout_s:.3f} s",
                        name=self._name,
                        t_s=t_s,
                        timeout_s=timeout_s,
                    )
                ) from error
            self._frame_count = frame + 1
            self._next = number + 1
            white = int(np.iinfo(image.dtype).max)
            return FileFrame(image, white, ready_s, start_s, number)

    def _first_frame(self, t_s: float) -> tuple[int, float]:
        """Return number and begin [cell s] of the first frame delivered wholly after ``t_s``.

        Frames follow each other by the clock from the first one ever; those that came while nobody
        looked are gone but for the last.
        """
        begun_s = self._running_s if self._begun_s is None else self._begun_s
        over_s = self._clock.now_s() - self._exposure_s - self._period_s
        from_s = max(t_s, self._running_s, over_s)
        frame = max(math.ceil((from_s - begun_s) / self._period_s - 1e-9), self._frame_count)
        return frame, begun_s + frame * self._period_s

    async def _picture(self, number: int) -> tuple[Image, int]:
        """Return the picture of a number and its number; behind the last one, another turn."""
        for _ in range(2):
            if self._loops and self._count is not None:
                number %= self._count
            answer = await self._call("picture", _NUMBER.pack(number), partial(self._read, number))
            if len(answer) > _NUMBER.size:
                return _unpacked(answer), number
            (self._count,) = _NUMBER.unpack(answer)
            if not self._loops:
                break
        await self._tear_down()
        raise UnpluggedError(self._at_end())

    def _at_end(self) -> str:
        return say(
            "{name}: all {count} pictures have been shown ({words}); to begin "
            "anew give it `settings: {{at_end: loop}}`",
            name=self._name,
            count=self._count,
            words=self._words,
        )

    # --- in its thread --------------------------------------------------------------------------

    def _open(self) -> bytes:
        image = self._source.open()
        return _packed(image) + self._source.words.encode()

    def _read(self, number: int) -> bytes:
        """Return a picture; after the last one, the number of pictures."""
        image = self._source.read(number)
        return _NUMBER.pack(self._source.count) if image is None else _packed(image)

    async def _call(self, what: str, sent: bytes, do: Callable[[], bytes]) -> bytes:
        if self._tap is None:
            return await self._run(do)
        return await self._run(self._tap.call, what, sent, do)

    async def _run(self, verb: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
        if self._worker is None:
            raise LinkError(say("{name}: not connected", name=self._name))
        # the thread is part of this process: an emulated cell must not count its delay
        with self._clock.held():
            return await asyncio.wrap_future(self._worker.submit(verb, *args, **kwargs))

    async def _wait(self, duration_s: float) -> None:
        assert self._closing is not None, "a connected camera can be closed"
        if duration_s > 0:
            await self._clock.wait([self._closing], duration_s)
        if self._closing.done():
            raise LinkError(say("{name}: closed during a wait", name=self._name))

    async def _tear_down(self) -> None:
        """Release the files. The thread does it last, even if this wait is cancelled."""
        self._shape, self._is_paused = None, False
        worker, self._worker = self._worker, None
        if worker is None:
            return
        closing = worker.submit(self._source.close)
        worker.shutdown(wait=False)
        await asyncio.shield(asyncio.wrap_future(closing))
        worker.shutdown(wait=True)  # the thread has nothing left to do


def _packed(image: Image) -> bytes:
    height, width = image.shape
    return _HEAD.pack(height, width, image.itemsize) + image.tobytes()


def _end_of(data: bytes) -> int:
    height, width, item = _HEAD.unpack_from(data)
    return int(_HEAD.size + height * width * item)


def _unpacked(data: bytes) -> Image:
    height, width, item = _HEAD.unpack_from(data)
    if item not in (1, 2) or len(data) < _end_of(data):
        raise BadReplyError(
            say(
                "a picture of {height} x {width} x {item} bytes in {data_count}",
                height=height,
                width=width,
                item=item,
                data_count=len(data),
            )
        )
    count, at = height * width, _HEAD.size
    if item == 1:
        return np.frombuffer(data, np.uint8, count, at).reshape(height, width)
    return np.frombuffer(data, np.uint16, count, at).reshape(height, width)
