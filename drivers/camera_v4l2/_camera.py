"""A measuring camera, asynchronous: a frame exposed wholly after an instant, or a typed error.

Knows V4L2 and pictures' bytes; not lamps, lenses or parts. Who switches a lamp passes the instant
the switch was acknowledged (plus its settling time) to ``frame_after``.
"""

import asyncio
import dataclasses
import errno
import math
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Final, ParamSpec, Self, TypeVar

from drivers.clock import REAL_TIME, CellClock
from drivers.errors import (
    FaultError,
    LinkError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
)
from drivers.tallies import tally_words
from drivers.wires import UNTAPPED, Wires
from messages import key, say

from .capture import (
    CameraConfig,
    CameraIdentity,
    CameraStats,
    CaptureSession,
    ControlInfo,
    ControlSetting,
    Frame,
)
from .kernel import UNIX_PREFIX, KernelCalls, SocketCalls, SysCalls, TappedCalls

_P = ParamSpec("_P")
_R = TypeVar("_R")

_MIN_BACKOFF_WALL_S: Final = 1e-3
_FIRST_RETRY_S: Final = 0.1
_LAST_RETRY_S: Final = 1.0


def system_calls_for(device: str) -> SysCalls:
    """Return the system calls for this address: over a unix socket, or the kernel's."""
    return SocketCalls() if device.startswith(UNIX_PREFIX) else KernelCalls()


class Camera:
    """One V4L2 camera.

    Every call to the camera is made on one thread of its own, in order; so the event loop never
    waits for a device, and a cancelled call leaves the camera as the next one finds it. `reconnect`
    and `set_exposure` are for scripts and commissioning.

    Parameters
    ----------
    config : address and settings
    clock : the cell's clock; all durations and instants here are its seconds
    calls : system calls; by default those that fit the address
    wires : recorder or player of the calls
    name : name of the camera, for the wires
    """

    def __init__(
        self,
        config: CameraConfig,
        clock: CellClock = REAL_TIME,
        calls: SysCalls | None = None,
        wires: Wires = UNTAPPED,
        name: str = "camera",
    ) -> None:
        self._config, self._clock = config, clock
        calls = calls or system_calls_for(config.device)
        tap = wires.camera(name)
        self._calls = calls if tap is None else TappedCalls(calls, tap)
        self._wires, self._name = wires, name
        self._lock = asyncio.Lock()
        self._stats = CameraStats()
        self._exposure_s = config.exposure_s
        self._capture: CaptureSession | None = None
        self._worker: Executor | None = None
        self._waiter: asyncio.Future[None] | None = None
        self._is_paused = False
        self._is_closing = False

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def connect(self) -> None:
        """Find and open the camera, agree on a format, lock the automatics, start the frames.

        Controls that could not be set are listed in ``settings``; they do not prevent a picture.

        Raises
        ------
        LinkError : no such camera is plugged in
        UnpluggedError : it left meanwhile, or is not ready yet
        WrongDeviceError : not a camera, or none whose pictures can be read
        RefusedError : no permission, or another program has it
        BadReplyError : answers that contradict themselves
        ValueError : it is connected already
        """
        async with self._lock:
            if self._capture is not None:
                raise ValueError(f"camera {self._config.device}: already connected")
            self._worker = self._wires.thread(self._name)
            self._capture = CaptureSession(self._config, self._clock, self._calls, self._stats)
            self._is_paused = False
            try:
                await self._run(self._capture.open, self._exposure_s)
            except BaseException:
                await self._tear_down()
                raise

    async def reconnect(self, timeout_s: float) -> None:
        """Look for the camera until it is back, with growing pauses [cell s].

        A camera that was plugged in again takes half a second, may have another node, and for a
        moment refuses (ENODEV, or EACCES before its permissions are set).

        Raises
        ------
        DeviceError : the last refusal, once the time is over
        """
        deadline_s = self._clock.now_s() + timeout_s
        pause_s = _FIRST_RETRY_S
        await self.close()
        while True:
            try:
                return await self.connect()
            except (LinkError, RefusedError) as error:
                is_final = isinstance(error, RefusedError) and error.code != errno.EACCES
                if is_final or self._clock.now_s() + pause_s > deadline_s:
                    raise
            await self._clock.sleep(pause_s)
            pause_s = min(2 * pause_s, _LAST_RETRY_S)

    async def close(self) -> None:
        """Stop the frames and close the camera; a wait in progress ends with ``LinkError``."""
        self._is_closing = True
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
        try:
            async with self._lock:
                await self._tear_down()
        finally:
            self._is_closing = False

    @property
    def model(self) -> str:
        """The camera's name in messages and the journal: card and kernel driver, once connected."""
        if self._capture is None:
            return key("V4L2 camera")
        identity = self.identity()
        return f"{identity.card} ({identity.driver})"

    @property
    def is_connected(self) -> bool:
        """Whether the camera is open, as far as is known."""
        return self._capture is not None

    @property
    def is_paused(self) -> bool:
        """Whether the frames are stopped."""
        return self._is_paused

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width the camera sends [px]."""
        pixel_format = self._open().format
        return pixel_format.height, pixel_format.width

    @property
    def frame_period_s(self) -> float:
        """Time between two frames, as the camera states it [cell s]."""
        return self._open().period_s

    @property
    def exposure_s(self) -> float | None:
        """Exposure the camera has [cell s]; None if unknown or automatic."""
        return self._open().exposure_s

    @property
    def settings(self) -> tuple[ControlSetting, ...]:
        """The result for each control that was to be locked or set."""
        return self._open().settings

    @property
    def stats(self) -> CameraStats:
        """A copy of the tallies; they go on over reconnections."""
        return dataclasses.replace(self._stats)

    def identity(self) -> CameraIdentity:
        """Return the camera's own identity."""
        return self._open().identity()

    async def controls(self) -> tuple[ControlInfo, ...]:
        """Return every control with its range and value; a failing one has the reason."""
        async with self._lock:
            return await self._call(self._open().controls)

    async def set_exposure(self, exposure_s: float) -> float:
        """Set the exposure, keep it over reconnections, and return the one the camera took.

        The next frames are passed over until the change has taken effect.

        Raises
        ------
        RefusedError : an automatic is on (code EACCES) or the value is outside the camera's range
        ValueError : the exposure is not above 0 s
        """
        if not exposure_s > 0:
            raise ValueError(f"an exposure of {exposure_s} s")
        async with self._lock:
            taken_s = await self._call(self._open().set_exposure, exposure_s)
            self._exposure_s = exposure_s
            return taken_s

    async def pause(self) -> None:
        """Stop the frames, so that an idle camera costs nothing."""
        async with self._lock:
            capture = self._open()
            if not self._is_paused:
                await self._call(capture.pause)
                self._is_paused = True

    async def resume(self) -> None:
        """Start the frames again."""
        async with self._lock:
            capture = self._open()
            if self._is_paused:
                await self._call(capture.resume)
                self._is_paused = False

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> Frame:
        """Return the first good frame exposed wholly after an instant.

        Frames that waited in the queue, that are flagged bad, short or broken, or that may still
        have an earlier exposure are passed over and counted (``stats``).

        Parameters
        ----------
        t_s : instant on the clock's scale [cell s]
        timeout_s : patience from now on [cell s]; by default what frame rate and exposure
            explain, plus the configured ``frame_timeout_s``

        Raises
        ------
        ReplyTimeoutError : no such frame in time
        UnpluggedError : the camera left; it is closed, ``reconnect`` finds it again
        FaultError : its stream broke twice; it is closed
        ValueError : the camera is paused
        """
        async with self._lock:
            capture = self._open()
            if self._is_paused:
                raise ValueError(f"camera {self._config.device}: paused; resume it first")
            ahead_s = max(0.0, t_s - self._clock.now_s())
            if timeout_s is None:
                timeout_s = ahead_s + capture.longest_wait_s() + self._config.frame_timeout_s
            before = self.stats
            try:
                async with self._clock.timeout(timeout_s):
                    # no frame that is wanted can end before
                    await self._wait(asyncio.get_running_loop().create_future(), ahead_s)
                    return await self._first_frame(capture, t_s)
            except TimeoutError as error:
                raise ReplyTimeoutError(
                    say(
                        "camera {device}: no frame exposed after {t_s:.3f} s within "
                        "{timeout_s:.3f} s: {tally_words}",
                        device=self._config.device,
                        t_s=t_s,
                        timeout_s=timeout_s,
                        tally_words=tally_words(before, self._stats),
                    )
                ) from error

    async def _first_frame(self, capture: CaptureSession, t_s: float) -> Frame:
        await self._call(capture.begin_wait)
        backoff_s, has_woken = capture.period_s / 8, False
        while True:
            look = await self._call(capture.look, t_s)
            self._raise_if_closing()
            if look.frame is not None:
                return look.frame
            if not look.is_empty:
                continue
            if has_woken and not look.dequeued_count:
                # POLLERR of a stream without buffers, say: it stays readable, so do not spin
                await self._clock.sleep(max(backoff_s, _MIN_BACKOFF_WALL_S * self._clock.speed))
                backoff_s = min(2 * backoff_s, capture.period_s)
            else:
                backoff_s = capture.period_s / 8
            await self._wait_until_ready(capture)
            has_woken = True

    async def _wait_until_ready(self, capture: CaptureSession) -> None:
        loop, fd = asyncio.get_running_loop(), capture.readiness_fd()
        waiter: asyncio.Future[None] = loop.create_future()

        def wake() -> None:
            if not waiter.done():
                waiter.set_result(None)

        try:
            loop.add_reader(fd, wake)
        except PermissionError:
            # a file that epoll refuses, since its file system cannot poll: look now and then
            return await self._wait(waiter, capture.period_s / 4)
        try:
            await self._wait(waiter)
        finally:
            loop.remove_reader(fd)

    async def _wait(self, waiter: asyncio.Future[None], limit_s: float | None = None) -> None:
        """Wait for ``waiter``, for ``limit_s`` [cell s] at most, or for the camera to be closed."""
        self._waiter = waiter
        try:
            await self._clock.wait([waiter], math.inf if limit_s is None else limit_s)
        finally:
            self._waiter = None
            waiter.cancel()
        self._raise_if_closing()

    def _raise_if_closing(self) -> None:
        if self._is_closing:
            raise LinkError(
                say("camera {device}: closed during a wait", device=self._config.device)
            )

    def _open(self) -> CaptureSession:
        if self._capture is None:
            raise LinkError(say("camera {device}: not connected", device=self._config.device))
        return self._capture

    async def _call(self, verb: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Run a verb on the camera's thread; one that ends the connection closes it here too."""
        try:
            return await self._run(verb, *args, **kwargs)
        except (UnpluggedError, FaultError):
            await self._tear_down()
            raise

    async def _run(self, verb: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
        if self._worker is None:
            raise LinkError(say("camera {device}: not connected", device=self._config.device))
        # the thread is part of this process: an emulated cell must not count its delay
        with self._clock.held():
            return await asyncio.wrap_future(self._worker.submit(verb, *args, **kwargs))

    async def _tear_down(self) -> None:
        """Close what is open. The thread runs it last, even if this wait is cancelled."""
        capture, self._capture = self._capture, None
        worker, self._worker = self._worker, None
        self._is_paused = False
        if capture is None or worker is None:
            return
        closing = worker.submit(capture.close)
        worker.shutdown(wait=False)
        await asyncio.shield(asyncio.wrap_future(closing))
        worker.shutdown(wait=True)  # the thread has nothing left to do
