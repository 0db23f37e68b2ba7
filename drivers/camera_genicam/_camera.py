"""The camera as the cell sees it: calls on a thread of its own, waits by the cell's clock."""

import asyncio
import dataclasses
import functools
import json
import struct
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from typing import Any, Final, Self

import numpy as np

from drivers.clock import REAL_TIME, CellClock
from drivers.errors import (
    BadReplyError,
    DeviceError,
    LinkError,
    NoLibraryError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
    WrongDeviceError,
)
from drivers.tallies import tally_words
from drivers.wires import UNTAPPED, Wires
from messages import key, say

from ._aravis import Aravis
from ._formats import Image
from ._session import HeldError, Library, Session
from ._types import CameraConfig, CameraIdentity, CameraStats, Frame, Setting

HELD_CODE: Final = 16  # EBUSY, as for a V4L2 camera that another program has
USUAL_PACKET_SIZE: Final = 1500  # every Ethernet passes it [bytes]
PACKET_HEADER_BYTES: Final = 36  # of a packet: IP 20, UDP 8, GVSP 8 (GigE Vision 1.x)
_HELD_POLL_S: Final = 0.25
_HEAD: Final = struct.Struct("<I")  # length of the JSON before the pixels
# errors that a session raises, by their names in a recording
_ERRORS: Final = {
    one.__name__: one
    for one in (
        BadReplyError,
        LinkError,
        NoLibraryError,
        UnpluggedError,
        WrongDeviceError,
    )
}

Answer = tuple[Mapping[str, Any], bytes]


@functools.cache
def load_library() -> Library:
    """Return aravis, loaded once a process.

    Raises
    ------
    NoLibraryError : it is not installed, or too old
    """
    return Aravis.load()


class Camera:
    """One GenICam camera, GigE Vision or USB3 Vision.

    It exposes by software trigger alone, so that a frame's earliest light is known without its
    clock: it is the instant before its trigger was sent.

    Parameters
    ----------
    config : address and settings
    clock : the cell's clock; all durations and instants here are its seconds
    library : returns the library; by default aravis
    wires : recorder or player of the calls
    name : name of the camera, for the wires
    """

    def __init__(
        self,
        config: CameraConfig,
        clock: CellClock = REAL_TIME,
        library: Callable[[], Library] = load_library,
        wires: Wires = UNTAPPED,
        name: str = "camera",
    ) -> None:
        self._config, self._clock, self._library = config, clock, library
        self._wires, self._name, self._tap = wires, name, wires.camera(name)
        self._lock = asyncio.Lock()
        self._stats = CameraStats()
        self._session: Session | None = None
        self._worker: Executor | None = None
        self._identity: CameraIdentity | None = None
        self._is_paused = False
        self._is_over = threading.Event()  # nobody waits for the present call any more
        self._closing: asyncio.Future[None] | None = None

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # --- opening and closing --------------------------------------------------------------------

    async def connect(self) -> CameraIdentity:
        """Find the camera, take control, set and read back everything; return its identity.

        A frame is taken and thrown away, so that a camera whose frames do not get here is known
        now. A program on this computer that ended without releasing the camera holds it until the
        camera misses its heartbeat; so long it is waited for.

        Raises
        ------
        NoLibraryError : aravis is not installed
        LinkError : no such camera answers, or no frame gets here
        RefusedError : another program has control (code 16), or a setting is refused
        WrongDeviceError : another model or serial number, or a camera that lacks a feature
        ValueError : it is connected already
        """
        async with self._lock:
            if self._identity is not None:
                raise ValueError(f"{self._words}: already connected")
            self._worker = self._wires.thread(self._name)
            self._closing = asyncio.get_running_loop().create_future()
            self._is_paused = False
            try:
                await self._call("find", self._find)
                await self._take_control()
                found, _ = await self._call("start", self._start)
                self._identity = CameraIdentity(**found)
                for _ in range(max(1, self._config.settle_frame_count)):
                    await self._frame(self._clock.now_s(), self._longest_wait_s())
                    self._stats.settling_count += 1
            except BaseException:
                await self._tear_down()
                raise
            return self._identity

    async def close(self) -> None:
        """Stop and release the camera; a wait in progress ends with ``LinkError``."""
        if self._closing is not None and not self._closing.done():
            self._closing.set_result(None)
        self._is_over.set()
        async with self._lock:
            await self._tear_down()

    @property
    def model(self) -> str:
        """The camera's name in messages and the journal: vendor, model, serial number."""
        return key("GenICam camera") if self._identity is None else self._identity.words

    @property
    def firmware(self) -> str:
        """Version of the camera's firmware; empty if it has none."""
        return "" if self._identity is None else self._identity.firmware

    @property
    def is_connected(self) -> bool:
        """Whether the camera is open, as far as is known."""
        return self._identity is not None

    @property
    def is_paused(self) -> bool:
        """Whether no frames are taken."""
        return self._is_paused

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of its pictures [px]."""
        identity = self.identity()
        return identity.height, identity.width

    @property
    def settings(self) -> tuple[Setting, ...]:
        """Every feature that was set and read back; empty in a playback."""
        return () if self._session is None else self._session.settings

    @property
    def stats(self) -> CameraStats:
        """A copy of the tallies; they go on over reconnections."""
        return dataclasses.replace(self._stats)

    def identity(self) -> CameraIdentity:
        """Return the camera's own identity.

        Raises
        ------
        LinkError : it is not connected
        """
        if self._identity is None:
            raise LinkError(say("{words}: not connected", words=self._words))
        return self._identity

    # --- frames ---------------------------------------------------------------------------------

    async def pause(self) -> None:
        """Take no frames. Without a trigger the camera sends none, so nothing is sent to it."""
        async with self._lock:
            self.identity()
            self._is_paused = True

    async def resume(self) -> None:
        """Take frames again."""
        async with self._lock:
            self.identity()
            self._is_paused = False

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> Frame:
        """Return a frame that is triggered after an instant.

        Parameters
        ----------
        t_s : instant on the clock's scale [cell s]
        timeout_s : patience from now on [cell s]; by default until then, what frame rate and
            exposure explain, and the configured lateness

        Raises
        ------
        ReplyTimeoutError : no such frame in time
        UnpluggedError : the camera left, or another program took it; it is closed
        BadReplyError : frames that were not triggered, or of another format
        ValueError : it is paused
        """
        async with self._lock:
            self.identity()
            if self._is_paused:
                raise ValueError(f"{self._words}: paused; resume it first")
            if timeout_s is None:
                timeout_s = max(0.0, t_s - self._clock.now_s()) + self._longest_wait_s()
            frame = await self._frame(t_s, timeout_s)
            self._stats.delivered_count += 1
            return frame

    def _longest_wait_s(self) -> float:
        return self._config.frame_s + self._config.frame_late_s

    async def _frame(self, t_s: float, timeout_s: float) -> Frame:
        before = self.stats
        try:
            async with self._clock.timeout(timeout_s):
                await self._wait(t_s - self._clock.now_s())
                asked_s = self._clock.now_s()
                head, pixels = await self._call(
                    "frame", functools.partial(self._take, asked_s), is_quick=False
                )
                # where a recording answers, the frame comes when it came then
                await self._wait(asked_s + head["took_s"] - self._clock.now_s())
        except TimeoutError as error:
            raise ReplyTimeoutError(
                say(
                    "{words}: no whole frame triggered after {t_s:.3f} s within "
                    "{timeout_s:.3f} s: {tally_words}{hint}",
                    words=self._words,
                    t_s=t_s,
                    timeout_s=timeout_s,
                    tally_words=tally_words(before, self._stats),
                    hint=self._hint(before),
                )
            ) from error
        image: Image
        if head["item_bytes"] == 1:
            image = np.frombuffer(pixels, np.uint8).reshape(self.shape)
        else:
            image = np.frombuffer(pixels, np.uint16).reshape(self.shape)
        return Frame(
            image,
            head["white"],
            asked_s + head["took_s"],
            asked_s,
            self.identity().exposure_s,
            head["frame_id"],
            head["stamp_ns"],
        )

    def _hint(self, before: CameraStats) -> str:
        """Return what to check in the network when no whole frame has come."""
        identity = self.identity()
        size, now = identity.packet_size, self._stats
        if not size:
            return ""
        (form,) = (one for one in self._config.formats if one.name == identity.pixel_format)
        frame_bytes = identity.width * identity.height * form.item_bytes
        full_count = frame_bytes // (size - PACKET_HEADER_BYTES)
        came = now.incomplete_count - before.incomplete_count
        missing = now.missing_packet_count - before.missing_packet_count
        if came and missing < came * full_count:
            return (
                "; packets come, but not all: raise `net.core.rmem_max` of this computer, or give "
                "the cameras a card of their own"
            )
        if size > USUAL_PACKET_SIZE:
            # of a frame, the two packets without pixels are small
            return say(
                "; if packets of {size} bytes do not pass the network, set its "
                "`packet_size` to {usual_packet_size}",
                size=size,
                usual_packet_size=USUAL_PACKET_SIZE,
            )
        return "" if came else "; a firewall must let UDP from the camera through"

    # --- on the thread --------------------------------------------------------------------------

    def _find(self) -> Answer:
        self._session = Session(self._config, self._clock, self._library(), self._stats)
        self._session.find()
        return {}, b""

    def _control(self) -> Answer:
        try:
            self._opened().take_control()
        except HeldError as error:
            return vars(error), b""
        return {}, b""

    def _start(self) -> Answer:
        return dataclasses.asdict(self._opened().start()), b""

    def _take(self, asked_s: float) -> Answer:
        taken = self._opened().take(self._is_over.is_set)
        took_s = self._clock.now_s() - asked_s
        if taken is None:  # nobody waits for it: a playback waits as long
            return {"took_s": took_s}, b""
        head = {
            "took_s": took_s,
            "white": taken.white,
            "frame_id": taken.frame_id,
            "stamp_ns": taken.stamp_ns,
            "item_bytes": taken.image.itemsize,
        }
        return head, taken.image.tobytes()

    def _opened(self) -> Session:
        if self._session is None:
            raise LinkError(say("{words}: not connected", words=self._words))
        return self._session

    # --- inside ---------------------------------------------------------------------------------

    @property
    def _words(self) -> str:
        return say("camera {address}", address=self._config.address)

    async def _take_control(self) -> None:
        """Take control; wait for the heartbeat of a program here that may have died.

        Raises
        ------
        RefusedError : another program has it
        """
        until_s: float | None = None
        while True:
            held, _ = await self._call("control", self._control)
            if not held:
                return
            if until_s is None:
                until_s = self._clock.now_s() + held["heartbeat_s"] + _HELD_POLL_S
            if not held["is_ours"] or self._clock.now_s() >= until_s:
                who = (
                    say("the program at {holder}", holder=held["holder"])
                    if held["holder"]
                    else key("another program")
                )
                raise RefusedError(
                    say(
                        "{words}: busy, {who} controls it; end that program",
                        words=self._words,
                        who=who,
                    ),
                    HELD_CODE,
                )
            await self._wait(_HELD_POLL_S)

    async def _wait(self, duration_s: float) -> None:
        """Wait [cell s], or until it is closed.

        Raises
        ------
        LinkError : it is being closed
        """
        assert self._closing is not None, "a connected camera can be closed"
        if duration_s > 0:
            await self._clock.wait([self._closing], duration_s)
        if self._closing.done():
            raise LinkError(say("{words}: closed during a wait", words=self._words))

    async def _call(self, what: str, do: Callable[[], Answer], *, is_quick: bool = True) -> Answer:
        """Make a call on the camera's thread, by way of the tap; one that finds it gone closes it.

        Parameters
        ----------
        what : its name in a recording
        do : makes it
        is_quick : False if it waits for the camera, whose time must go on meanwhile
        """
        if self._worker is None:
            raise LinkError(say("{words}: not connected", words=self._words))
        is_over = self._is_over = threading.Event()

        def answer() -> bytes:
            try:
                head, data = do()
            except DeviceError as error:
                head = {"error": type(error).__name__, "message": str(error)}
                if isinstance(error, RefusedError):
                    head["code"] = error.code
                data = b""
            words = json.dumps(dict(head)).encode()
            return _HEAD.pack(len(words)) + words + data

        call = answer if self._tap is None else functools.partial(self._tap.call, what, b"", answer)
        try:
            # the thread is part of this process: an emulated cell must not count its delay
            with self._clock.held() if is_quick else nullcontext():
                found = await asyncio.wrap_future(self._worker.submit(call))
        except BaseException:
            is_over.set()
            raise
        head, data = _unpacked(found)
        if "error" in head:
            error = _error_of(head)
            if isinstance(error, UnpluggedError):
                await self._tear_down()
            raise error
        return head, data

    async def _tear_down(self) -> None:
        """Close what is open. The thread runs it last, even if this wait is cancelled."""
        session, self._session = self._session, None
        worker, self._worker = self._worker, None
        self._identity, self._is_paused = None, False
        if worker is None:
            return
        closing = worker.submit(_nothing if session is None else session.close)
        worker.shutdown(wait=False)
        await asyncio.shield(asyncio.wrap_future(closing))
        worker.shutdown(wait=True)  # the thread has nothing left to do


def _nothing() -> None:
    pass


def _unpacked(data: bytes) -> Answer:
    (length,) = _HEAD.unpack_from(data)
    end = _HEAD.size + length
    return json.loads(data[_HEAD.size : end]), data[end:]


def _error_of(head: Mapping[str, Any]) -> DeviceError:
    if head["error"] == RefusedError.__name__:
        return RefusedError(head["message"], head["code"])
    return _ERRORS[head["error"]](head["message"])
