"""The same ioctl structs over a unix stream socket, for a camera that cannot be a device node.

An emulated camera is served like this where FUSE cannot be mounted. The wire: each request is
``<IIQ`` (kind, size, arg) and ``size`` bytes; each reply ``<iI`` (0 or -errno, size) and ``size``
bytes. Kind 1 is an ioctl (arg: request number, payload: the struct, back and forth). Kind 2 maps
(payload ``<QQ``: length, offset; the reply carries a memfd to be mapped at that offset). Kind 3
asks for events (the reply carries a descriptor that yields one byte a finished frame and ends
when the camera is unplugged). A peer that goes away is a camera that was unplugged.
"""

import array
import errno
import mmap
import os
import socket
import struct
from dataclasses import dataclass
from typing import Final

from messages import key, say

UNIX_PREFIX: Final = "unix:"

_REQUEST: Final = struct.Struct("<IIQ")
_REPLY: Final = struct.Struct("<iI")
_MAP: Final = struct.Struct("<QQ")
_IOCTL_KIND, _MMAP_KIND, _EVENTS_KIND = 1, 2, 3
_MAX_REPLY_BYTES: Final = 1 << 14  # an ioctl's size field has 14 bits
_MAX_ERRNO: Final = 4095  # limit of the kernel, include/linux/err.h
_EVENT_GULP_BYTES: Final = 4096
HANG_WALL_S: Final = 120.0  # the peer is an emulator, which may be slow: only a hang ends the wait


@dataclass(slots=True)
class _Line:
    socket: socket.socket
    events_fd: int
    is_broken: bool = False


class SocketCalls:
    """System calls answered by an emulated camera at ``unix:/path/to.sock``.

    Parameters
    ----------
    reply_timeout_wall_s : the peer's time for one reply on the wall clock [s]; after it the
        line is out of step and every further call fails with ENODEV
    """

    def __init__(self, reply_timeout_wall_s: float = HANG_WALL_S) -> None:
        self._reply_timeout_wall_s = reply_timeout_wall_s
        self._lines: dict[int, _Line] = {}

    def open(self, path: str) -> int:
        """Connect, subscribe to the camera's events, and return the socket's descriptor."""
        line = _Line(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM), events_fd=-1)
        try:
            line.socket.settimeout(self._reply_timeout_wall_s)
            line.socket.connect(path.removeprefix(UNIX_PREFIX))
            line.events_fd = self._ask_for_fd(line, _EVENTS_KIND, b"")
            os.set_blocking(line.events_fd, False)
        except BaseException:
            line.socket.close()
            if line.events_fd >= 0:
                os.close(line.events_fd)
            raise
        fd = line.socket.fileno()
        self._lines[fd] = line
        return fd

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> None:
        """Send the struct, and take the camera's version back.

        Parameters
        ----------
        fd : the number that `open` returned for this camera
        request : the ioctl's request number; it contains the size of the struct
        buffer : the struct; overwritten with the camera's version of it

        Raises
        ------
        OSError : the camera's errno, or EPROTO when a struct of another size comes back
        """
        answer, fds = self._exchange(self._line(fd), _IOCTL_KIND, request, bytes(buffer))
        _close_all(fds)
        if len(answer) != len(buffer):
            raise OSError(
                errno.EPROTO,
                say(
                    "ioctl 0x{request:08x}: {answer_count} bytes came back, not {buffer_count}",
                    request=request,
                    answer_count=len(answer),
                    buffer_count=len(buffer),
                ),
            )
        buffer[:] = answer

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Return a map of the memfd that the camera writes this buffer's pictures into.

        Parameters
        ----------
        fd : the number that `open` returned for this camera
        length : size of the buffer [bytes], from QUERYBUF
        offset : start of the buffer in the camera's memory [bytes], from QUERYBUF
        """
        memory_fd = self._ask_for_fd(self._line(fd), _MMAP_KIND, _MAP.pack(length, offset))
        try:
            return mmap.mmap(
                memory_fd, length, flags=mmap.MAP_SHARED, prot=mmap.PROT_READ, offset=offset
            )
        finally:
            os.close(memory_fd)

    def readiness_fd(self, fd: int) -> int:
        """Return the events' descriptor."""
        return self._line(fd).events_fd

    def acknowledge(self, fd: int) -> None:
        """Swallow one byte for each frame announced; ENODEV at their end.

        Raises
        ------
        OSError : ENODEV, the camera is gone: its line of events has ended
        """
        line = self._line(fd)
        while True:
            try:
                announced = os.read(line.events_fd, _EVENT_GULP_BYTES)
            except BlockingIOError:
                return
            if not announced:
                raise OSError(errno.ENODEV, key("the camera's events have ended"))
            if len(announced) < _EVENT_GULP_BYTES:
                return

    def close(self, fd: int) -> None:
        """Hang up."""
        line = self._lines.pop(fd)
        os.close(line.events_fd)
        line.socket.close()

    def _line(self, fd: int) -> _Line:
        line = self._lines.get(fd)
        if line is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        return line

    def _ask_for_fd(self, line: _Line, kind: int, payload: bytes) -> int:
        _, fds = self._exchange(line, kind, 0, payload)
        if len(fds) != 1:
            _close_all(fds)
            raise OSError(
                errno.EPROTO,
                say(
                    "request {kind}: {fds_count} descriptors came, not one",
                    kind=kind,
                    fds_count=len(fds),
                ),
            )
        return fds[0]

    def _exchange(
        self, line: _Line, kind: int, arg: int, payload: bytes
    ) -> tuple[bytes, list[int]]:
        if line.is_broken:
            raise OSError(errno.ENODEV, key("the camera's socket is out of step since a time-out"))
        fds: list[int] = []
        is_whole = False
        try:
            line.socket.sendall(_REQUEST.pack(kind, len(payload), arg) + payload)
            result, size = _REPLY.unpack(_receive(line.socket, _REPLY.size, fds))
            if size > _MAX_REPLY_BYTES:
                raise OSError(errno.EPROTO, say("a reply of {size} bytes", size=size))
            if not -_MAX_ERRNO <= result <= 0:
                raise OSError(
                    errno.EPROTO, say("{result} is neither 0 nor an error's number", result=result)
                )
            answer = _receive(line.socket, size, fds)
            is_whole = True
        except TimeoutError as error:
            raise OSError(errno.ETIMEDOUT, key("the emulated camera does not reply")) from error
        except (BrokenPipeError, ConnectionResetError) as error:
            raise OSError(errno.ENODEV, key("the emulated camera hung up")) from error
        finally:
            if not is_whole:
                line.is_broken = True
                _close_all(fds)
        if result < 0:
            _close_all(fds)
            raise OSError(-result, os.strerror(-result))
        return answer, fds


def _receive(line: socket.socket, size: int, fds: list[int]) -> bytes:
    """Read exactly ``size`` bytes; descriptors that ride along are appended to ``fds``."""
    received = bytearray()
    while len(received) < size:
        piece, ancillary, _, _ = line.recvmsg(
            size - len(received), socket.CMSG_SPACE(4 * 4), socket.MSG_CMSG_CLOEXEC
        )
        for level, kind, data in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
                whole = array.array("i")
                whole.frombytes(data[: len(data) - len(data) % whole.itemsize])
                fds.extend(whole)
        if not piece:
            raise OSError(errno.ENODEV, key("the emulated camera hung up"))
        received += piece
    return bytes(received)


def _close_all(fds: list[int]) -> None:
    while fds:
        os.close(fds.pop())
