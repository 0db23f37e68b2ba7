"""Cameras as files of a FUSE mount: unmodified clients get a real fd with ioctl, poll and mmap.

A client must be another process than this one: a page fault that it takes while holding our
interpreter's lock would wait for the threads here, which wait for that lock. Whether a DQBUF
blocks is decided when the file is opened: a FUSE server does not learn of a later F_SETFL.
"""

import atexit
import errno
import itertools
import logging
import os
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from ..device import V4l2Device
from ..kernel import BUFFERS_MAX, SLOT_BYTES, NotYet, Refused
from ..kernel.abi import Poll
from . import _fuse_wire as wire
from ._fuse_wire import Notice, Opcode

log = logging.getLogger(__name__)

_ROOT: Final = 1
_NODE_BYTES: Final = BUFFERS_MAX * SLOT_BYTES
_CACHE_S: Final = 3600
_THREAD_COUNT: Final = 2  # one may be held up by a client's memory that itself waits for the camera


def can_mount() -> str | None:
    """Return None if a FUSE mount can be made, else the reason why not."""
    try:
        device_fd = os.open("/dev/fuse", os.O_RDWR | os.O_CLOEXEC)
    except OSError as error:
        return f"/dev/fuse cannot be opened: {error.strerror}"
    try:
        with tempfile.TemporaryDirectory(prefix="v4l2cam") as name:
            wire.mount(device_fd, Path(name))
            wire.unmount(Path(name))
    except OSError as error:
        return f"FUSE cannot be mounted: {os.strerror(error.errno or 0)}"
    finally:
        os.close(device_fd)
    return None


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A blocking DQBUF that is not answered yet."""

    unique: int
    number: int
    request: int
    data: bytes
    pid: int


@dataclass(slots=True, eq=False)
class _Node:
    """A file of the mount: one camera from one plugging-in to the next unplugging."""

    node_id: int
    name: str
    device: V4l2Device
    notify: Callable[..., None]
    answer: Callable[[_Waiting, "_Node"], bool]
    frames: dict[int, bytes] = field(default_factory=dict)  # slot -> the bytes last stored there
    files: dict[int, bool] = field(default_factory=dict)  # handle -> whether its DQBUF blocks
    poll_handles: dict[int, int] = field(default_factory=dict)  # poll handle -> file handle
    waiting: list[_Waiting] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def store(self, offset_bytes: int, frame: bytes) -> None:
        """Put a frame into the file's page cache, which is what clients have mapped."""
        self.frames[offset_bytes // SLOT_BYTES] = frame
        header = wire.STORE.pack(self.node_id, offset_bytes, len(frame), 0)
        self.notify(Notice.STORE, header, frame)

    def wake(self, frame_of: int | None) -> None:
        """Let the kernel poll again, and answer the DQBUFs that can be answered."""
        with self.lock:
            poll_handles = list(self.poll_handles)
            self.poll_handles.clear()
        for poll_handle in poll_handles:
            self.notify(Notice.POLL, wire.POLL_WAKEUP.pack(poll_handle))
        self.retry()

    def retry(self) -> None:
        """Answer the waiting DQBUFs that can be answered."""
        with self.lock:  # held throughout, so that a frame cannot slip between look and wait
            self.waiting = [wait for wait in self.waiting if not self.answer(wait, self)]


class FuseMount:
    """Serves cameras in a directory, each under its name.

    Attributes
    ----------
    failure : error that ended the service early; None while all is well
    """

    def __init__(self, directory: Path, on_failure: Callable[[], None] = lambda: None) -> None:
        self.directory = directory
        self.failure: BaseException | None = None
        self._on_failure = on_failure
        self._nodes: dict[int, _Node] = {}  # those of unplugged cameras stay: files are open
        self._names: dict[str, _Node] = {}
        self._node_ids = itertools.count(_ROOT + 1)
        self._threads: list[threading.Thread] = []
        self._device_fd = -1
        self._is_open = False

    def open(self) -> None:
        """Mount and serve. Raises OSError where FUSE cannot be mounted."""
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            if error.errno != errno.ENOTCONN:
                raise
            wire.unmount(self.directory)  # of a predecessor that was killed
        self._device_fd = os.open("/dev/fuse", os.O_RDWR | os.O_CLOEXEC)
        try:
            wire.mount(self._device_fd, self.directory)
        except OSError:
            os.close(self._device_fd)
            raise
        self._is_open = True
        atexit.register(self.close)
        self._threads = [
            threading.Thread(target=self._serve, name=f"fuse {self.directory} {i}", daemon=True)
            for i in range(_THREAD_COUNT)
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Unmount; clients that still hold files get ENOTCONN."""
        if not self._is_open:
            return
        self._is_open = False
        atexit.unregister(self.close)
        for node in self._names.values():
            node.device.detach(node)
        wire.unmount(self.directory)  # ends the threads' reads with ENODEV
        for thread in self._threads:
            thread.join()
        os.close(self._device_fd)
        for node in self._nodes.values():
            for number in node.files:
                node.device.close(number)

    def add(self, name: str, device: V4l2Device) -> Path:
        """Show a camera under a name; return its path."""
        node = _Node(next(self._node_ids), name, device, self._notify, self._answer)
        self._nodes[node.node_id] = node
        self._names[name] = node
        device.attach(node)
        return self.directory / name

    def remove(self, name: str) -> None:
        """Remove an unplugged camera's name; open files answer ENODEV."""
        node = self._names.pop(name)
        node.device.detach(node)
        node.frames.clear()
        encoded = os.fsencode(name)
        self._notify(
            Notice.INVAL_ENTRY, wire.INVAL_ENTRY.pack(_ROOT, len(encoded), 0), encoded + b"\0"
        )

    # -- the wire -----------------------------------------------------------------------------

    def _serve(self) -> None:
        try:
            while True:
                try:
                    request = os.read(self._device_fd, wire.READ_BYTES)
                except OSError as error:
                    if error.errno == errno.ENODEV:  # unmounted
                        return
                    if error.errno in (errno.EINTR, errno.ENOENT, errno.EAGAIN):
                        continue
                    raise
                self._handle(request)
        except BaseException as error:  # noqa: BLE001 - a mount nobody serves hangs its users
            self._abort(error)

    def _abort(self, error: BaseException) -> None:
        log.critical("camera mount %s is given up", self.directory, exc_info=error)
        self.failure = self.failure or error
        try:
            wire.unmount(self.directory)
        except OSError:
            os._exit(70)  # the kernel then ends the mount, which alone still frees its users
        self._on_failure()

    def _reply(self, unique: int, data: bytes = b"", error: int = 0) -> None:
        self._write([wire.REPLY.pack(wire.REPLY.size + len(data), -error, unique), data])

    def _notify(self, notice: Notice, *parts: bytes) -> None:
        length = wire.REPLY.size + sum(len(part) for part in parts)
        self._write([wire.REPLY.pack(length, notice, 0), *parts])

    def _write(self, parts: list[bytes]) -> None:
        try:
            os.writev(self._device_fd, parts)
        except OSError as error:
            # ENOENT: the client went away meanwhile; the others: the mount did
            if error.errno not in (errno.ENOENT, errno.ENODEV, errno.EPERM, errno.EBADF):
                raise

    def _handle(self, message: bytes) -> None:
        _, opcode, unique, node_id, _, _, pid = wire.REQUEST.unpack_from(message)
        body = message[wire.REQUEST.size :]
        if opcode in (Opcode.FORGET, Opcode.BATCH_FORGET):
            return  # the kernel expects no answer
        if opcode == Opcode.INTERRUPT:
            self._interrupt(unique, wire.INTERRUPT_IN.unpack_from(body)[0])
            return
        node = self._nodes.get(node_id)
        if opcode == Opcode.IOCTL and node is not None:
            self._ioctl(unique, node, pid, body)
            return
        try:
            self._reply(unique, self._answer_to(opcode, node, body))
        except Refused as refusal:
            self._reply(unique, error=refusal.number)

    def _answer_to(self, opcode: int, node: _Node | None, body: bytes) -> bytes:
        """Return the reply to a request about the mount (`node` None) or a file."""
        match opcode:
            case Opcode.INIT:
                return self._init(body)
            case Opcode.LOOKUP:
                return self._lookup(body)
            case Opcode.GETATTR | Opcode.SETATTR:
                return wire.ATTR_OUT.pack(_CACHE_S, 0, 0) + self._attr(node)
            case Opcode.OPENDIR:
                return wire.OPEN_OUT.pack(0, 0, 0)
            case Opcode.READDIR:
                return self._readdir(body)
            case Opcode.RELEASEDIR | Opcode.FLUSH | Opcode.FSYNC | Opcode.DESTROY:
                return b""
        if node is None:
            raise Refused(errno.ENOSYS)
        match opcode:
            case Opcode.OPEN:
                return self._open_file(node, body)
            case Opcode.RELEASE:
                return self._release(node, body)
            case Opcode.READ:
                return self._read(node, body)
            case Opcode.WRITE:  # a page that a client wrote into; the device has no use for it
                return wire.WRITE_OUT.pack(wire.READ_IN.unpack_from(body)[2], 0)
            case Opcode.POLL:
                return self._poll(node, body)
        raise Refused(errno.ENOSYS)

    def _init(self, body: bytes) -> bytes:
        _, minor, readahead, flags = wire.INIT_IN.unpack_from(body)
        return wire.INIT_OUT.pack(
            7, min(minor, 38), readahead, flags & wire.INIT_FLAGS, 16, 12,
            wire.MAX_WRITE_BYTES, 1, wire.MAX_WRITE_BYTES // 4096, 0, 0,
        )  # fmt: skip

    def _attr(self, node: _Node | None) -> bytes:
        node_id, size, mode = _ROOT, 0, 0o40700
        if node is not None:
            node_id, size, mode = node.node_id, _NODE_BYTES, 0o100600
        owner = os.getuid(), os.getgid()
        return wire.ATTR.pack(node_id, size, 0, 0, 0, 0, 0, 0, 0, mode, 1, *owner, 0, 4096, 0)

    def _lookup(self, body: bytes) -> bytes:
        node = self._names.get(os.fsdecode(body.rstrip(b"\0")))
        if node is None:
            raise Refused(errno.ENOENT)
        # a name is valid for no time: it may be another camera's by the next open
        return wire.ENTRY_OUT.pack(node.node_id, 1, 0, _CACHE_S, 0, 0) + self._attr(node)

    def _readdir(self, body: bytes) -> bytes:
        _, offset, size, _ = wire.READ_IN.unpack_from(body)
        entries = b""
        for position, node in enumerate(list(self._names.values())[offset:], offset + 1):
            name = os.fsencode(node.name)
            entry = wire.DIRENT.pack(node.node_id, position, len(name), 8) + name
            entry += b"\0" * (-len(entry) % 8)
            if len(entries) + len(entry) > size:
                break
            entries += entry
        return entries

    # -- files ----------------------------------------------------------------------------------

    def _open_file(self, node: _Node, body: bytes) -> bytes:
        flags = wire.OPEN_IN.unpack_from(body)[0]
        if self._names.get(node.name) is not node:
            raise Refused(errno.ENODEV)
        number = node.device.open()
        node.files[number] = not flags & os.O_NONBLOCK
        return wire.OPEN_OUT.pack(number, wire.OPEN_KEEP_CACHE, 0)

    def _release(self, node: _Node, body: bytes) -> bytes:
        number = wire.RELEASE_IN.unpack_from(body)[0]
        node.device.close(number)
        node.files.pop(number, None)
        with node.lock:
            node.poll_handles = {p: f for p, f in node.poll_handles.items() if f != number}
        return b""

    def _read(self, node: _Node, body: bytes) -> bytes:
        """Fill pages that no frame was stored to yet, or that the kernel has dropped."""
        _, offset, size, _ = wire.READ_IN.unpack_from(body)
        slot, start = divmod(offset, SLOT_BYTES)
        return node.frames.get(slot, b"")[start : start + size].ljust(size, b"\0")

    def _poll(self, node: _Node, body: bytes) -> bytes:
        number, poll_handle, flags, events = wire.POLL_IN.unpack_from(body)
        if flags & wire.POLL_SCHEDULE_NOTIFY:
            with node.lock:
                node.poll_handles[poll_handle] = number
        # looked at after the registration, so that nothing is missed between the two
        return wire.POLL_OUT.pack(node.device.poll(number) & (events | Poll.ERR | Poll.HUP), 0)

    def _ioctl(self, unique: int, node: _Node, pid: int, body: bytes) -> None:
        number, _, request, _, in_size, _ = wire.IOCTL_IN.unpack_from(body)
        start = wire.IOCTL_IN.size
        waiting = _Waiting(unique, number, request, body[start : start + in_size], pid)
        if self._answer(waiting, node):
            return
        with node.lock:
            node.waiting.append(waiting)
        node.retry()  # a frame may have come since

    def _answer(self, ask: _Waiting, node: _Node) -> bool:
        """Answer an ioctl; False if it has to wait."""
        try:
            result, data = node.device.ioctl(
                ask.number,
                ask.request,
                ask.data,
                memory=wire.ProcessMemory(ask.pid),
                is_blocking=node.files.get(ask.number, False),
            )
        except NotYet:
            return False
        is_read = ask.request >> 30 & 2  # the client's kernel takes as many bytes as it asked for
        # a negative result travels as the ioctl's value: the kernel hands it on as the errno
        self._reply(ask.unique, wire.IOCTL_OUT.pack(result, 0, 0, 0) + (data if is_read else b""))
        return True

    def _interrupt(self, unique: int, victim: int) -> None:
        """End a waiting DQBUF because its client got a signal."""
        for node in list(self._nodes.values()):
            with node.lock:
                hit = [wait for wait in node.waiting if wait.unique == victim]
                node.waiting = [wait for wait in node.waiting if wait.unique != victim]
            if hit:
                self._reply(victim, error=errno.EINTR)
                return
        # not waiting yet, the other thread is at it: the kernel shall repeat the interrupt
        self._reply(unique, error=errno.EAGAIN)
