"""A V4L2 camera as a plain object: ioctl numbers and bytes in, bytes out.

Written after the V4L2 specification and the observed behaviour of uvcvideo and videobuf2.
Independent of the client's connection (a transport carries the ioctls and holds the buffers' bytes)
and of the making of pictures (a `PictureSource` makes them elsewhere, and `deliver` brings them).
"""

import asyncio
import contextlib
import errno
import itertools
import threading
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Final, Protocol

from ..kernel import (
    BufferQueue,
    CameraConfig,
    CaptureSettings,
    ClientMemory,
    ControlBank,
    Handle,
    Picture,
    Refused,
    abi,
)
from ..kernel.abi import Poll, Request
from ._faults import Faults
from ._sensor import Clock, PictureSource, Sensor

_PAUSE_WALL_S: Final = 0.0005


class Outlet(Protocol):
    """A transport's service to the device."""

    def store(self, offset_bytes: int, frame: bytes) -> None:
        """Put a frame's bytes where clients have mapped them."""

    def wake(self, frame_of: int | None) -> None:
        """Look at poll and at waiting DQBUFs again; `frame_of`: the handle that got a frame."""


@dataclass(frozen=True, slots=True, eq=False)
class _Call:
    """One ioctl under way; `data` is changed in place."""

    handle: Handle
    data: bytearray
    memory: ClientMemory | None
    is_blocking: bool


class V4l2Device:
    """One emulated camera; every method may be called from any thread.

    Parameters
    ----------
    source : source of pictures
    clock : the world's time
    config : name, formats, sizes, rates and controls of the camera
    """

    def __init__(
        self, source: PictureSource, clock: Clock, config: CameraConfig | None = None
    ) -> None:
        self.config = config or CameraConfig()
        self._source, self._clock = source, clock
        self._lock = threading.RLock()
        self._numbers = itertools.count(1)
        self._handles: dict[int, Handle] = {}
        self._outlets: tuple[Outlet, ...] = ()
        self._is_plugged = True
        self._is_wake_due = False
        self._rouse: Callable[[], None] = lambda: None  # `run`, from its sleep
        self._power_up(Faults())

    def _power_up(self, faults: Faults) -> None:
        self._settings = settings = CaptureSettings(self.config)
        self._controls = controls = ControlBank(
            self.config.controls, lambda: self._clock.to_monotonic_s(self._clock.now_s())
        )
        self._buffers = BufferQueue()
        self._sensor = Sensor(
            self._source,
            self._clock,
            self.config,
            settings,
            controls,
            self._buffers,
            self._lock,
            store=self._store,
            wake=self._wake,
            able=lambda: self._rouse(),
        )
        self._sensor.faults = faults
        self._of_camera: dict[Request, Callable[[bytearray], object]] = {
            Request.QUERYCAP: settings.querycap,
            Request.ENUM_FMT: settings.enum_fmt,
            Request.G_FMT: settings.g_fmt,
            Request.TRY_FMT: settings.try_fmt,
            Request.S_FMT: lambda data: settings.s_fmt(data, is_busy=self._buffers.are_allocated),
            Request.G_PARM: settings.g_parm,
            Request.S_PARM: lambda data: settings.s_parm(data, is_busy=self._buffers.is_streaming),
            Request.ENUMINPUT: settings.enuminput,
            Request.G_INPUT: settings.g_input,
            Request.S_INPUT: settings.s_input,
            Request.ENUM_FRAMESIZES: settings.enum_framesizes,
            Request.ENUM_FRAMEINTERVALS: settings.enum_frameintervals,
            Request.QUERYCTRL: controls.queryctrl,
            Request.QUERY_EXT_CTRL: controls.query_ext_ctrl,
            Request.QUERYMENU: controls.querymenu,
            Request.G_CTRL: controls.g_ctrl,
            Request.QUERYBUF: self._buffers.querybuf,
        }
        self._of_call: dict[Request, Callable[[_Call], object]] = {
            Request.G_PRIORITY: self._g_priority,
            Request.S_PRIORITY: self._s_priority,
            Request.S_CTRL: self._s_ctrl,
            Request.G_EXT_CTRLS: lambda call: self._ext_ctrls(Request.G_EXT_CTRLS, call),
            Request.S_EXT_CTRLS: lambda call: self._ext_ctrls(Request.S_EXT_CTRLS, call),
            Request.TRY_EXT_CTRLS: lambda call: self._ext_ctrls(Request.TRY_EXT_CTRLS, call),
            Request.SUBSCRIBE_EVENT: self._subscribe_event,
            Request.UNSUBSCRIBE_EVENT: lambda c: controls.unsubscribe_event(c.handle, c.data),
            Request.DQEVENT: lambda call: controls.dqevent(call.handle, call.data),
            Request.REQBUFS: self._reqbufs,
            Request.QBUF: lambda call: self._buffers.qbuf(call.handle, call.data),
            Request.DQBUF: self._dqbuf,
            Request.STREAMON: self._streamon,
            Request.STREAMOFF: self._streamoff,
        }

    # -- the emulator's side ------------------------------------------------------------------

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the frames that are set."""
        return self._settings.size_px

    @property
    def is_plugged(self) -> bool:
        """Whether the camera is there."""
        return self._is_plugged

    @property
    def is_streaming(self) -> bool:
        """Whether a client has frames flowing."""
        return self._buffers.is_streaming

    @property
    def lost_count(self) -> int:
        """Frames since the stream began for which there was no buffer or no picture."""
        return self._sensor.lost_count

    @property
    def faults(self) -> Faults:
        """The present faults of the camera; assign to change them."""
        return self._sensor.faults

    @faults.setter
    def faults(self, faults: Faults) -> None:
        with self._lock:
            self._sensor.faults = faults
            self._sensor.review()

    @property
    def oldest_due_s(self) -> float | None:
        """The end of the oldest frame whose picture is still being made; None without one."""
        return self._sensor.oldest_due_s

    def attach(self, outlet: Outlet) -> None:
        """Let a transport hold the frames' bytes and be woken."""
        with self._lock:
            self._outlets = (*self._outlets, outlet)

    def detach(self, outlet: Outlet) -> None:
        """Forget a transport."""
        with self._lock:
            self._outlets = tuple(other for other in self._outlets if other is not outlet)

    def unplug(self) -> None:
        """Pull the cable: every open file is dead for good (ENODEV), every waiter is woken."""
        with self._lock:
            self._is_plugged = False
            self._handles.clear()
            self._buffers.release(None)
            self._sensor.stop()
        self._wake(None)

    def plug(self) -> None:
        """Put the cable back: the camera has lost its settings; files are to be opened anew."""
        with self._lock:
            if not self._is_plugged:
                self._is_plugged = True
                self._power_up(self._sensor.faults)

    async def run(self) -> None:
        """Take frames as world time passes, until cancelled; sleep while no buffer is queued."""
        loop = asyncio.get_running_loop()
        due = asyncio.Event()

        def rouse() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed, and `run` with it
                loop.call_soon_threadsafe(due.set)

        self._rouse = rouse
        try:
            while True:
                due.clear()
                next_s = self.advance(self._clock.now_s())
                if next_s is None:
                    await due.wait()
                    continue
                # time may stand still: look again, but not without a pause
                at_wall_s = max(self._clock.to_monotonic_s(next_s), loop.time() + _PAUSE_WALL_S)
                timer = loop.call_at(at_wall_s, due.set)
                try:
                    await due.wait()
                finally:
                    timer.cancel()
        finally:
            self._rouse = lambda: None

    def advance(self, now_s: float) -> float | None:
        """Take the frame that ended last, if it has a place to go; those before it are lost.

        Parameters
        ----------
        now_s : the world's instant [world s]

        Returns
        -------
        When to call again [world s]; None: not before a client or a picture changes something.
        """
        return self._sensor.advance(now_s)

    def deliver(self, ticket: Hashable, picture: Picture) -> None:
        """Bring the picture of a ticket: it is encoded, put in its buffer, and the client woken.

        Takes from 1 ms to 10 ms (a JPEG of 1280×1024): call it from a thread where an event loop
        cannot spare that. A ticket whose stream has ended meanwhile is let go.

        Parameters
        ----------
        ticket : return value of the order of the picture
        picture : (height, width) uint8 or uint16, of `size_px` or a whole multiple of it

        Raises
        ------
        ValueError : the picture has another shape or depth
        """
        self._sensor.deliver(ticket, picture)

    def abandon(self, ticket: Hashable) -> None:
        """Give a ticket's picture up: its frame is lost, its buffer is free."""
        self._sensor.abandon(ticket)

    # -- the client's side --------------------------------------------------------------------

    def open(self) -> int:
        """Open the camera; return the handle's number.

        Raises
        ------
        Refused : ENODEV, the camera is unplugged
        """
        with self._lock:
            if not self._is_plugged:
                raise Refused(errno.ENODEV)
            number = next(self._numbers)
            self._handles[number] = Handle(number)
            return number

    def close(self, number: int) -> None:
        """Close a handle: its stream ends, its buffers are freed."""
        with self._lock:
            handle = self._handles.pop(number, None)
            if handle is None or handle is not self._buffers.owner:
                return
            self._buffers.release(handle)
            self._sensor.stop()
        self._wake(None)

    def poll(self, number: int) -> int:
        """Return poll(2)'s bits for a handle."""
        with self._lock:
            handle = self._handles.get(number)
            if handle is None:
                return Poll.ERR | Poll.HUP | Poll.PRI
            return self._buffers.poll() | (Poll.PRI if handle.events else 0)

    def may_map(self, number: int, length_bytes: int, offset_bytes: int) -> bool:
        """Return whether an mmap(2) range is that of an existing buffer.

        Parameters
        ----------
        number : the handle's
        length_bytes : size of the range
        offset_bytes : start of the buffer, as QUERYBUF gave it
        """
        with self._lock:
            return number in self._handles and self._buffers.may_map(length_bytes, offset_bytes)

    def ioctl(
        self,
        number: int,
        request: int,
        data: bytes,
        *,
        memory: ClientMemory | None = None,
        is_blocking: bool = False,
    ) -> tuple[int, bytes]:
        """Answer an ioctl.

        Parameters
        ----------
        number : the handle's
        request : the ioctl's request number; an unknown one is answered with ENOTTY
        data : the struct as the client passed it; where it is shorter, zeros follow
        memory : access to what a struct points at, None where pointers cannot be followed
        is_blocking : the file was opened without O_NONBLOCK

        Returns
        -------
        0 or -errno, and the struct as the client gets it back

        Raises
        ------
        NotYet : a blocking DQBUF has to wait
        AssertionError : the answer has another size than the struct: a bug of this emulator
        """
        size = abi.size_of_request(request)
        if len(data) > size:
            return -errno.EINVAL, data
        buffer = bytearray(data.ljust(size, b"\0"))
        with self._lock:
            self._is_wake_due = False
            try:
                handle = self._handles.get(number)
                if handle is None:
                    raise Refused(errno.ENODEV)
                self._carry_out(request, _Call(handle, buffer, memory, is_blocking))
            except Refused as refusal:
                return -refusal.number, bytes(buffer)
            if len(buffer) != size:
                raise AssertionError(f"request {request:#x}: {size} bytes in, {len(buffer)} out")
            self._sensor.review()
            is_wake_due = self._is_wake_due
        if is_wake_due:
            self._wake(None)
        return 0, bytes(buffer)

    def _carry_out(self, request: int, call: _Call) -> None:
        if request not in self._of_camera and request not in self._of_call:
            raise Refused(errno.ENOTTY)
        known = Request(request)
        if known in abi.NEEDS_PRIORITY and call.handle.priority < self._highest_priority():
            raise Refused(errno.EBUSY)
        if known in self._of_camera:
            self._of_camera[known](call.data)
        else:
            self._of_call[known](call)

    def _highest_priority(self) -> int:
        return max(handle.priority for handle in self._handles.values())

    def _g_priority(self, call: _Call) -> None:
        call.data[:] = abi.U32.pack(self._highest_priority())

    def _s_priority(self, call: _Call) -> None:
        wish = abi.U32.unpack(call.data)[0]
        if not abi.PRIORITY_BACKGROUND <= wish <= abi.PRIORITY_RECORD:
            raise Refused(errno.EINVAL)
        call.handle.priority = wish

    def _s_ctrl(self, call: _Call) -> None:
        self._change_controls(self._controls.s_ctrl(call.data), call.handle)

    def _ext_ctrls(self, request: Request, call: _Call) -> None:
        wishes = self._controls.ext_ctrls(request, call.data, call.memory)
        self._change_controls(wishes, call.handle)

    def _change_controls(self, wishes: Iterable[tuple[int, int]], by: Handle) -> None:
        first_frame = self._sensor.next_frame()
        for cid, value in wishes:
            self._is_wake_due |= self._controls.change(
                cid, value, first_frame, self._handles.values(), by
            )

    def _subscribe_event(self, call: _Call) -> None:
        self._is_wake_due |= self._controls.subscribe_event(call.handle, call.data)

    def _reqbufs(self, call: _Call) -> None:
        self._buffers.reqbufs(call.handle, call.data, self._settings.frame_bytes)

    def _dqbuf(self, call: _Call) -> None:
        self._buffers.dqbuf(call.handle, call.data, is_blocking=call.is_blocking)

    def _streamon(self, call: _Call) -> None:
        if self._buffers.streamon(call.handle, call.data):
            self._sensor.start()

    def _streamoff(self, call: _Call) -> None:
        self._buffers.streamoff(call.handle, call.data)
        self._sensor.stop()
        self._is_wake_due = True

    # -- towards the transports ----------------------------------------------------------------

    def _store(self, offset_bytes: int, frame: bytes) -> None:
        for outlet in self._outlets:
            outlet.store(offset_bytes, frame)

    def _wake(self, frame_of: int | None) -> None:
        for outlet in self._outlets:
            outlet.wake(frame_of)
