"""A scripted V4L2 camera: ioctl structs in and out, frames when the test says so.

Its offsets are read from linux/videodev2.h anew, apart from the driver's; it decides nothing by
itself and has no clock. `FakeCalls` puts it behind the driver's system-call interface in-process,
`SocketServer` behind a unix socket.
"""

from __future__ import annotations

import array
import asyncio
import contextlib
import errno
import mmap
import os
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

SLOT_BYTES = 1 << 20  # where the buffers lie in the camera's memory
MONOTONIC, START_OF_EXPOSURE, ERROR = 0x2000, 0x10000, 0x40
UNPLUGGED = errno.ENODEV

NAMES = {  # request number without direction and size, from videodev2.h
    0: "QUERYCAP",
    2: "ENUM_FMT",
    5: "S_FMT",
    8: "REQBUFS",
    9: "QUERYBUF",
    15: "QBUF",
    17: "DQBUF",
    18: "STREAMON",
    19: "STREAMOFF",
    22: "S_PARM",
    27: "G_CTRL",
    28: "S_CTRL",
    36: "QUERYCTRL",
    37: "QUERYMENU",
}


@dataclass
class FakeControl:
    name: str
    value: int
    minimum: int = 0
    maximum: int = 100
    step: int = 1
    type: int = 1
    flags: int = 0
    menu: dict[int, str] = field(default_factory=dict)
    locked_by: int = 0  # an automatic that must be at `manual` for this to be set
    manual: int = 0
    read_error: int = 0
    is_deaf: bool = False  # takes a value and does nothing


def usual_controls() -> dict[int, FakeControl]:
    return {
        0x0098090C: FakeControl("White Balance, Automatic", 1, 0, 1, type=2),
        0x00980913: FakeControl("Gain", 10),
        0x0098091A: FakeControl(
            "White Balance Temperature", 4600, 2800, 6500, 10, locked_by=0x0098090C
        ),
        0x009A0901: FakeControl(
            "Auto Exposure",
            3,
            0,
            3,
            type=3,
            menu={1: "Manual Mode", 3: "Aperture Priority Mode"},
        ),
        0x009A0902: FakeControl(
            "Exposure Time, Absolute", 157, 1, 5000, locked_by=0x009A0901, manual=1
        ),
    }


@dataclass
class FakeBuffer:
    state: str = "idle"
    raw: bytes = b""


class FakeCamera:
    def __init__(
        self, width: int = 8, height: int = 4, formats: tuple[str, ...] = ("GREY",)
    ) -> None:
        self.width, self.height, self.formats = width, height, formats
        self.row_padding = 0
        self.forced_format: str | None = None
        self.field_order = 1
        self.driver, self.card, self.bus = b"fake", b"Scripted Camera", b"usb-0000:00:14.0-1"
        self.capabilities, self.device_caps = 0x84200001, 0x04200001
        self.granted_period: tuple[int, int] | None = None
        self.granted_buffers = 32
        self.controls = usual_controls()
        self.buffers: list[FakeBuffer] = []
        self.queued: list[int] = []
        self.done: list[int] = []
        self.is_streaming = self.is_gone = False
        self.is_stuck_ready = False  # polls readable with nothing to read, as on POLLERR
        self.sequence = 0
        self.format: tuple[str, int, int] = ("GREY", width, 0)
        self.log: list[str] = []
        self.seen: Counter[str] = Counter()
        self.failures: dict[str, list[int]] = {}
        self.lock = threading.RLock()
        self.hold: threading.Event | None = None  # every ioctl waits for it
        self.write: Callable[[int, bytes], None] = lambda offset, data: None
        self.changed: Callable[[bool], None] = lambda is_new_frame: None

    # -- what the test does ------------------------------------------------------------------

    def finish(
        self,
        data: bytes,
        stamp_s: float,
        *,
        flags: int = MONOTONIC,
        bytesused: int | None = None,
        lost: int = 0,
    ) -> bool:
        """Fill the oldest queued buffer; without one the frame is lost, its number is not."""
        with self.lock:
            self.sequence = (self.sequence + lost) % 2**32
            sequence, self.sequence = self.sequence, (self.sequence + 1) % 2**32
            if not (self.is_streaming and self.queued):
                return False
            index = self.queued.pop(0)
            self.write(index * SLOT_BYTES, data)
            used = len(data) if bytesused is None else bytesused
            self.buffers[index] = FakeBuffer("done", b"")
            self._describe(index, used, flags | 4, round(stamp_s * 1e6), sequence)
            self.done.append(index)
        self.changed(True)
        return True

    def unplug(self) -> None:
        with self.lock:
            self.is_gone = True
        self.changed(False)

    def released(self) -> None:
        """The last descriptor is closed: nobody owns the buffers any more."""
        with self.lock:
            self._stop()
            self.buffers = []

    def fail(self, name: str, *codes: int) -> None:
        """Let the next calls of this name fail, one for each errno."""
        self.failures[name] = list(codes)

    @property
    def is_ready(self) -> bool:
        return bool(self.done) or self.is_gone or self.is_stuck_ready

    # -- ioctls ------------------------------------------------------------------------------

    def ioctl(self, request: int, buffer: bytearray) -> None:
        name, size = NAMES.get(request & 0xFF, "?"), request >> 16 & 0x3FFF
        self.log.append(name)  # asked
        if self.hold is not None:
            assert self.hold.wait(5.0)
        with self.lock:
            try:
                self._answer(name, size, buffer)
            finally:
                self.seen[name] += 1  # answered
        if name in ("DQBUF", "STREAMOFF", "REQBUFS"):
            self.changed(False)

    def _answer(self, name: str, size: int, buffer: bytearray) -> None:
        if self.is_gone:
            raise OSError(UNPLUGGED, "gone")
        if size != len(buffer):
            raise OSError(errno.EFAULT, f"{name}: {len(buffer)} bytes, not {size}")
        if self.failures.get(name):
            code = self.failures[name].pop(0)
            if code:
                raise OSError(code, os.strerror(code))
        verb: Callable[[bytearray], None] | None = getattr(self, "_" + name.lower(), None)
        if verb is None:
            raise OSError(errno.ENOTTY, name)
        verb(buffer)
        assert len(buffer) == size, name

    def _querycap(self, b: bytearray) -> None:
        caps = (0x060102, self.capabilities, self.device_caps)
        struct.pack_into("<16s32s32sIII", b, 0, self.driver, self.card, self.bus, *caps)

    def _enum_fmt(self, b: bytearray) -> None:
        index, kind = struct.unpack_from("<II", b)
        if kind != 1 or index >= len(self.formats):
            raise OSError(errno.EINVAL, "end")
        b[44:48] = self.formats[index].ljust(4).encode()

    def _s_fmt(self, b: bytearray) -> None:
        if self.buffers:
            raise OSError(errno.EBUSY, "buffers exist")
        asked = b[16:20].decode().rstrip()
        name = self.forced_format or (asked if asked in self.formats else self.formats[0])
        bytes_per_px = {"GREY": 1, "MJPG": 0}.get(name, 2)
        line = self.width * bytes_per_px + (self.row_padding if bytes_per_px else 0)
        size = line * self.height if bytes_per_px else self.width * self.height * 2
        struct.pack_into("<II", b, 8, self.width, self.height)
        b[16:20] = name.ljust(4).encode()
        struct.pack_into("<III", b, 20, self.field_order, line, size)
        self.format = (name, line, size)

    def _s_parm(self, b: bytearray) -> None:
        struct.pack_into("<I", b, 4, 0x1000)
        if self.granted_period is not None:
            struct.pack_into("<II", b, 12, *self.granted_period)

    def _reqbufs(self, b: bytearray) -> None:
        count, kind, memory = struct.unpack_from("<III", b)
        if (kind, memory) != (1, 1):
            raise OSError(errno.EINVAL, "memory")
        self._stop()
        count = min(count, self.granted_buffers)
        self.buffers = [FakeBuffer() for _ in range(count)]
        for index in range(count):
            self._describe(index, 0, 0, 0, 0)
        struct.pack_into("<I", b, 0, count)

    def _describe(self, index: int, used: int, flags: int, stamp_us: int, sequence: int) -> None:
        raw = bytearray(88)
        struct.pack_into("<IIIII", raw, 0, index, 1, used, flags | 1, 1)
        struct.pack_into("<qq", raw, 24, stamp_us // 10**6, stamp_us % 10**6)
        struct.pack_into("<II", raw, 56, sequence, 1)
        struct.pack_into("<QI", raw, 64, index * SLOT_BYTES, self.format[2])
        self.buffers[index].raw = bytes(raw)

    def _index(self, b: bytearray) -> int:
        index, kind = struct.unpack_from("<II", b)
        if kind != 1 or index >= len(self.buffers):
            raise OSError(errno.EINVAL, "buffer")
        return int(index)

    def _querybuf(self, b: bytearray) -> None:
        b[:] = self.buffers[self._index(b)].raw

    def _qbuf(self, b: bytearray) -> None:
        index = self._index(b)
        if self.buffers[index].state != "idle" or struct.unpack_from("<I", b, 60)[0] != 1:
            raise OSError(errno.EINVAL, "not ours")
        self.buffers[index].state = "queued"
        self.queued.append(index)

    def _dqbuf(self, b: bytearray) -> None:
        if struct.unpack_from("<I", b, 4)[0] != 1 or not self.is_streaming:
            raise OSError(errno.EINVAL, "not streaming")
        if not self.done:
            raise OSError(errno.EAGAIN, "nothing")
        index = self.done.pop(0)
        self.buffers[index].state = "idle"
        b[:] = self.buffers[index].raw

    def _streamon(self, b: bytearray) -> None:
        if struct.unpack("<I", b)[0] != 1 or not self.buffers:
            raise OSError(errno.EINVAL, "no buffers")
        self.is_streaming, self.sequence = True, 0

    def _streamoff(self, b: bytearray) -> None:
        self._stop()

    def _stop(self) -> None:
        self.is_streaming = False
        self.queued, self.done = [], []
        for buffer in self.buffers:
            buffer.state = "idle"

    def _control(self, b: bytearray) -> FakeControl:
        found = self.controls.get(struct.unpack_from("<I", b)[0])
        if found is None:
            raise OSError(errno.EINVAL, "no such control")
        return found

    def _queryctrl(self, b: bytearray) -> None:
        (wanted,) = struct.unpack_from("<I", b)
        if wanted & 0x80000000:
            above = [cid for cid in sorted(self.controls) if cid > wanted & 0x7FFFFFFF]
            if not above:
                raise OSError(errno.EINVAL, "end")
            wanted = above[0]
        elif wanted not in self.controls:
            raise OSError(errno.EINVAL, "no such control")
        c = self.controls[wanted]
        flags = c.flags | (0x10 if self._is_locked(c) else 0)
        struct.pack_into(
            "<II32siiiiI",
            b,
            0,
            wanted,
            c.type,
            c.name.encode(),
            c.minimum,
            c.maximum,
            c.step,
            c.minimum,
            flags,
        )

    def _querymenu(self, b: bytearray) -> None:
        index = struct.unpack_from("<I", b, 4)[0]
        text = self._control(b).menu.get(index)
        if text is None:
            raise OSError(errno.EINVAL, "no such item")
        b[8:40] = text.encode().ljust(32, b"\0")

    def _g_ctrl(self, b: bytearray) -> None:
        control = self._control(b)
        if control.read_error:
            raise OSError(control.read_error, "unreadable")
        struct.pack_into("<i", b, 4, control.value)

    def _s_ctrl(self, b: bytearray) -> None:
        control, value = self._control(b), struct.unpack_from("<i", b, 4)[0]
        if self._is_locked(control):
            raise OSError(errno.EACCES, "automatic is on")
        if control.menu and value not in control.menu:
            raise OSError(errno.EINVAL, "no such item")
        if not control.is_deaf:
            control.value = max(control.minimum, min(control.maximum, value))

    def _is_locked(self, control: FakeControl) -> bool:
        automatic = self.controls.get(control.locked_by)
        return automatic is not None and automatic.value != control.manual


class FakeCalls:
    """The driver's system calls, answered in-process by whichever cameras are plugged in."""

    def __init__(self, camera: FakeCamera, path: str = "/dev/video0") -> None:
        self.nodes: dict[str, FakeCamera] = {path: camera}
        self.open_cameras: dict[int, FakeCamera] = {}
        self.maps: list[LoggedMap] = []
        self.memfds: dict[int, int] = {}
        self.memories: dict[int, mmap.mmap] = {}
        self.log: list[str] = []
        self.readiness_override: int | None = None

    def open(self, path: str) -> int:
        camera = self.nodes.get(path)
        if camera is None:
            raise OSError(errno.ENOENT, "no such node")
        if camera.is_gone:
            raise OSError(UNPLUGGED, "gone")
        memfd = os.memfd_create("fake")
        os.ftruncate(memfd, 8 * SLOT_BYTES)
        memory = mmap.mmap(memfd, 8 * SLOT_BYTES)
        fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.memories[fd], self.memfds[fd] = memory, memfd
        camera.log = self.log

        def write(offset: int, data: bytes) -> None:
            memory[offset : offset + len(data)] = data

        def changed(_: bool) -> None:  # a level, as V4L2 has it: set while there is something
            with camera.lock:
                if fd not in self.open_cameras:
                    return
                if camera.is_ready:
                    os.eventfd_write(fd, 1)
                else:
                    with contextlib.suppress(BlockingIOError):
                        os.eventfd_read(fd)

        camera.write, camera.changed = write, changed
        self.open_cameras[fd] = camera
        self.log.append("open")
        return fd

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> None:
        self.open_cameras[fd].ioctl(request, buffer)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        view = LoggedMap(
            self.memfds[fd], length, flags=mmap.MAP_SHARED, prot=mmap.PROT_READ, offset=offset
        )
        view.log = self.log
        self.maps.append(view)
        return view

    def readiness_fd(self, fd: int) -> int:
        return fd if self.readiness_override is None else self.readiness_override

    def acknowledge(self, fd: int) -> None:
        pass

    def close(self, fd: int) -> None:
        camera = self.open_cameras[fd]
        with camera.lock:
            del self.open_cameras[fd]
            camera.released()
        self.log.append("close")
        os.close(fd)
        self.memories.pop(fd).close()
        os.close(self.memfds.pop(fd))

    @property
    def is_all_released(self) -> bool:
        return not self.open_cameras and all(view.closed for view in self.maps)


class LoggedMap(mmap.mmap):
    """A map that tells when it is given back."""

    log: list[str]

    def close(self) -> None:
        self.log.append("unmap")
        super().close()


class SocketServer:
    """One camera at a unix socket; a thread for its one client."""

    def __init__(self, camera: FakeCamera, path: Path) -> None:
        self.camera, self.path = camera, path
        self.is_mute = False
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(path))
        self.listener.listen(4)
        self.events: int | None = None
        self.piece_bytes = 1 << 16  # how much of a reply is sent at once
        self.memfd = os.memfd_create("camera")
        os.ftruncate(self.memfd, 8 * SLOT_BYTES)
        self.memory = mmap.mmap(self.memfd, 8 * SLOT_BYTES)
        camera.write = self._write
        camera.changed = self._changed
        self.connection: socket.socket | None = None
        self.thread = threading.Thread(target=self._run, name="camera server")
        self.thread.start()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.listener.shutdown(socket.SHUT_RDWR)
        self.hang_up()
        self.thread.join(5.0)
        assert not self.thread.is_alive()
        self.listener.close()
        self._end_events()
        self.memory.close()
        os.close(self.memfd)

    def hang_up(self) -> None:
        if self.connection is not None:
            with contextlib.suppress(OSError):
                self.connection.shutdown(socket.SHUT_RDWR)

    def _write(self, offset: int, data: bytes) -> None:
        self.memory[offset : offset + len(data)] = data

    def _changed(self, is_new_frame: bool) -> None:
        with self.camera.lock:
            if self.camera.is_gone:
                self._end_events()
            elif is_new_frame and self.events is not None:
                os.write(self.events, b"f")

    def _end_events(self) -> None:
        with self.camera.lock:
            if self.events is not None:
                os.close(self.events)
                self.events = None

    def _run(self) -> None:
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            self.connection = connection
            with connection, contextlib.suppress(EOFError, OSError):
                self._serve(connection)
            self._end_events()
            self.camera.released()

    def _serve(self, connection: socket.socket) -> None:
        while True:
            kind, size, arg = struct.unpack("<IIQ", self._take(connection, 16))
            payload = bytearray(self._take(connection, size))
            if self.is_mute:
                continue
            fds: list[int] = []
            result = 0
            try:
                if kind == 1:
                    self.camera.ioctl(arg, payload)
                elif kind == 2:
                    length, offset = struct.unpack("<QQ", payload)
                    assert offset + length <= 8 * SLOT_BYTES
                    payload, fds = bytearray(), [self.memfd]
                elif kind == 3:
                    read_end, self.events = os.pipe()
                    payload, fds = bytearray(), [read_end]
                else:
                    result, payload = -errno.EINVAL, bytearray()
            except OSError as error:
                result = -(error.errno or errno.EIO)
            reply = struct.pack("<iI", result, len(payload)) + payload
            rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", fds))] if fds else []
            sent = connection.sendmsg([reply[: self.piece_bytes]], rights)
            while sent < len(reply):
                sent += connection.send(reply[sent : sent + self.piece_bytes])
            if kind == 3:
                os.close(fds[0])

    @staticmethod
    def _take(connection: socket.socket, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = connection.recv(size - len(data))
            if not piece:
                raise EOFError
            data += piece
        return data


async def until(claim: Callable[[], bool], limit_s: float = 5.0) -> None:
    """Wait until a claim about the other thread holds."""
    deadline = time.monotonic() + limit_s
    while not claim():
        assert time.monotonic() < deadline, "never came true"
        await asyncio.sleep(0.001)
