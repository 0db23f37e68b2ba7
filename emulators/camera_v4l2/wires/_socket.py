"""A camera over a unix socket, if no FUSE can be mounted: the same ioctl structs, word for word.

Each request is `<IIQ` (kind, size, argument) and `size` bytes; each reply `<iI` (0 or -errno, size)
and `size` bytes. Structs that hold pointers cannot cross: their ioctls are refused with ENOTTY.
"""

import array
import contextlib
import errno
import logging
import os
import socket
import threading
from enum import IntEnum
from pathlib import Path
from struct import Struct
from typing import Final

from emulators.owned import bind_owned

from ..device import V4l2Device
from ..kernel import BUFFERS_MAX, SLOT_BYTES, Refused, abi
from ..kernel.abi import Poll

log = logging.getLogger(__name__)

_REQUEST: Final = Struct("<IIQ")
_REPLY: Final = Struct("<iI")
_RANGE: Final = Struct("<QQ")  # length, offset
_DEAD_HANDLE: Final = 0  # no device counts its handles from there
_PAYLOAD_MAX_BYTES: Final = 0x3FFF  # the largest struct whose size fits an ioctl's number


class _Kind(IntEnum):
    IOCTL = 1
    MMAP = 2
    EVENTS = 3


class SocketCamera:
    """Listens for clients of one camera, from one plugging-in to the next unplugging.

    A connection is an open file. Frames lie in one memfd, at the offsets that QUERYBUF tells.
    """

    def __init__(self, device: V4l2Device, path: Path) -> None:
        self.path = path
        self._device = device
        self._memory_fd = -1
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._lock = threading.Lock()
        self._clients: set[_Client] = set()
        self._threads: list[threading.Thread] = []
        self._acceptor = threading.Thread(target=self._accept, name=str(path), daemon=True)

    def open(self) -> None:
        """Listen, for this user alone; a socket that a predecessor left there is replaced."""
        self.path.unlink(missing_ok=True)
        bind_owned(self._listener, self.path)
        self._listener.listen()
        self._memory_fd = os.memfd_create(self.path.name, os.MFD_CLOEXEC)
        os.ftruncate(self._memory_fd, BUFFERS_MAX * SLOT_BYTES)
        self._device.attach(self)
        self._acceptor.start()

    def retire(self) -> None:
        """Let nobody connect any more; connected clients stay, and get ENODEV."""
        self.path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # wakes accept, which closing does not
        self._acceptor.join()  # before the camera comes back: nobody slips from one to the other
        self._listener.close()

    def close(self) -> None:
        """Hang up on everybody and free everything."""
        self.retire()
        with self._lock:
            for client in self._clients:
                client.hang_up()
        for thread in self._threads:  # also of a client that has left a moment ago
            thread.join()
        self._device.detach(self)
        os.close(self._memory_fd)

    def store(self, offset_bytes: int, frame: bytes) -> None:
        """Put a frame where clients have mapped it."""
        os.pwrite(self._memory_fd, frame, offset_bytes)

    def wake(self, frame_of: int | None) -> None:
        """Notify a client of its finished frame; end the events of those whose camera is gone."""
        with self._lock:
            for client in self._clients:
                if client.number == frame_of:
                    client.tell_frame()
                elif frame_of is None and self._device.poll(client.number) & Poll.HUP:
                    client.end_events()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # retired
                return
            try:
                number = self._device.open()
            except Refused:  # unplugged a moment ago: a file that only hears ENODEV
                number = _DEAD_HANDLE
            client = _Client(connection, self._device, number, self._memory_fd)
            thread = threading.Thread(target=self._serve, args=(client,), daemon=True)
            with self._lock:
                self._clients.add(client)
            thread.start()
            self._threads = [known for known in self._threads if known.is_alive()] + [thread]

    def _serve(self, client: "_Client") -> None:
        try:
            client.serve()
        except Exception:
            log.exception("client of %s is dropped", self.path)
        finally:
            with self._lock:
                self._clients.remove(client)
                client.end_events()
            self._device.close(client.number)
            client.hang_up()


class _Client:
    """One connection: an open file of the camera."""

    def __init__(
        self, connection: socket.socket, device: V4l2Device, number: int, memory_fd: int
    ) -> None:
        self.number = number
        self._connection, self._device, self._memory_fd = connection, device, memory_fd
        self._event_fds: list[int] = []
        self._lock = threading.Lock()

    def serve(self) -> None:
        """Answer until the client hangs up or talks nonsense."""
        with self._connection, contextlib.suppress(EOFError, ConnectionError):
            while True:
                kind, size, argument = _REQUEST.unpack(self._receive(_REQUEST.size))
                if size > _PAYLOAD_MAX_BYTES:
                    log.warning("a request of %d bytes is no ioctl: hung up", size)
                    return
                self._answer(kind, argument, self._receive(size))

    def hang_up(self) -> None:
        """End the connection from this side."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def tell_frame(self) -> None:
        """Send one byte down each event pipe; a client that never reads them misses some."""
        with self._lock:
            for fd in self._event_fds:
                with contextlib.suppress(BlockingIOError, BrokenPipeError):
                    os.write(fd, b"f")

    def end_events(self) -> None:
        """Let the event pipes end."""
        with self._lock:
            for fd in self._event_fds:
                os.close(fd)
            self._event_fds.clear()

    def _receive(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            piece = self._connection.recv(size - len(data))
            if not piece:
                raise EOFError
            data += piece
        return bytes(data)

    def _answer(self, kind: int, argument: int, payload: bytes) -> None:
        match kind:
            case _Kind.IOCTL:
                self._ioctl(argument, payload)
            case _Kind.MMAP:
                self._mmap(payload)
            case _Kind.EVENTS:
                self._events()
            case _:
                self._reply(-errno.EINVAL)

    def _ioctl(self, request: int, data: bytes) -> None:
        if len(data) != abi.size_of_request(request):
            self._reply(-errno.EINVAL)
            return
        result, data = self._device.ioctl(self.number, request, data)
        self._reply(result, b"" if result else data)

    def _mmap(self, payload: bytes) -> None:
        if len(payload) != _RANGE.size:
            self._reply(-errno.EINVAL)
        elif self._device.poll(self.number) & Poll.HUP:
            self._reply(-errno.ENODEV)
        elif not self._device.may_map(self.number, *_RANGE.unpack(payload)):
            self._reply(-errno.EINVAL)
        else:
            self._reply(0, fd=self._memory_fd)

    def _events(self) -> None:
        read_fd, write_fd = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        with self._lock:
            self._event_fds.append(write_fd)
        try:
            # looked at after the pipe is known, so that an unplugging in between ends it
            if self._device.poll(self.number) & Poll.HUP:
                self.end_events()
                self._reply(-errno.ENODEV)
            else:
                self._reply(0, fd=read_fd)
        finally:
            os.close(read_fd)

    def _reply(self, result: int, data: bytes = b"", fd: int | None = None) -> None:
        message = _REPLY.pack(result, len(data)) + data
        if fd is None:
            self._connection.sendall(message)
        else:
            rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [fd]))
            self._connection.sendmsg([message], [rights])
