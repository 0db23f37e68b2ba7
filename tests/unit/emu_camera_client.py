"""A V4L2 client for tests, written independently from the kernel's documentation.

Speaks through any function that carries an ioctl, so that the plain device, the FUSE node and the
socket face the same questions.
"""

import fcntl
import os
import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass

# request numbers as `strace -X raw` prints them for any V4L2 program on x86-64
QUERYCAP, ENUM_FMT, G_FMT, S_FMT = 0x80685600, 0xC0405602, 0xC0D05604, 0xC0D05605
REQBUFS, QUERYBUF, QBUF, DQBUF = 0xC0145608, 0xC0585609, 0xC058560F, 0xC0585611
STREAMON, STREAMOFF, G_PARM, S_PARM = 0x40045612, 0x40045613, 0xC0CC5615, 0xC0CC5616
ENUMINPUT, G_CTRL, S_CTRL = 0xC050561A, 0xC008561B, 0xC008561C
QUERYCTRL, QUERYMENU, G_INPUT, S_INPUT = 0xC0445624, 0xC02C5625, 0x80045626, 0xC0045627
TRY_FMT, G_PRIORITY, S_PRIORITY = 0xC0D05640, 0x80045643, 0x40045644
G_EXT_CTRLS, S_EXT_CTRLS, TRY_EXT_CTRLS = 0xC0205647, 0xC0205648, 0xC0205649
ENUM_FRAMESIZES, ENUM_FRAMEINTERVALS = 0xC02C564A, 0xC034564B
DQEVENT, SUBSCRIBE_EVENT, UNSUBSCRIBE_EVENT = 0x80885659, 0x4020565A, 0x4020565B
QUERY_EXT_CTRL, CREATE_BUFS = 0xC0E85667, 0xC100565C

EXPOSURE_AUTO, EXPOSURE, GAIN, BRIGHTNESS = 0x009A0901, 0x009A0902, 0x00980913, 0x00980900
MONOTONIC, ERROR, SOE = 0x2000, 0x40, 0x10000

Carry = Callable[[int, bytes], tuple[int, bytes]]  # request, struct -> 0 or -errno, struct


def carry_over_file(fd: int) -> Carry:
    """Return the way of ioctls into a file."""

    def carry(request: int, data: bytes) -> tuple[int, bytes]:
        buffer = bytearray(data)
        try:
            fcntl.ioctl(fd, request, buffer)
        except OSError as error:
            return -(error.errno or 0), bytes(buffer)
        return 0, bytes(buffer)

    return carry


def exchange(
    link: socket.socket, kind: int, argument: int, payload: bytes
) -> tuple[int, bytes, list[int]]:
    """Put one request on the socket; return result, reply and the fds that came with it."""
    link.sendall(struct.pack("<IIQ", kind, len(payload), argument) + payload)
    head, fds, _, _ = socket.recv_fds(link, 8, 4)
    assert len(head) == 8, "the camera hung up"
    result, size = struct.unpack("<iI", head)
    data = b""
    while len(data) < size:
        data += link.recv(size - len(data))
    return result, data, fds


def carry_over_socket(link: socket.socket) -> Carry:
    """Return the way of ioctls over a socket."""

    def carry(request: int, data: bytes) -> tuple[int, bytes]:
        result, reply, fds = exchange(link, 1, request, data)
        assert fds == []
        return result, reply or data

    return carry


@dataclass(frozen=True, slots=True)
class Frame:
    index: int
    used_bytes: int
    flags: int
    stamp_us: int
    sequence: int
    offset_bytes: int
    length_bytes: int


@dataclass(slots=True)
class Client:
    carry: Carry

    def ask(self, request: int, data: bytes) -> bytes:
        """Carry out an ioctl; an OSError if the camera refuses."""
        result, reply = self.carry(request, data)
        if result:
            raise OSError(-result, os.strerror(-result))
        return reply

    def set_format(self, width: int, height: int, fourcc: str) -> tuple[int, int, str, int, int]:
        """Return width, height, fourcc, bytesperline, sizeimage as the camera made them."""
        code = int.from_bytes(fourcc.encode(), "little")
        reply = self.ask(S_FMT, struct.pack("<I4xIII", 1, width, height, code).ljust(208, b"\0"))
        width, height, code, _, line, size = struct.unpack_from("<6I", reply, 8)
        return width, height, code.to_bytes(4, "little").decode(), line, size

    def request_buffers(self, count: int) -> int:
        reply = self.ask(REQBUFS, struct.pack("<5I", count, 1, 1, 0, 0))
        return int.from_bytes(reply[:4], "little")

    def _buffer(self, request: int, index: int) -> Frame:
        data = bytearray(88)
        struct.pack_into("<II", data, 0, index, 1)
        struct.pack_into("<I", data, 60, 1)
        reply = self.ask(request, bytes(data))
        index, _, used, flags = struct.unpack_from("<4I", reply)
        seconds, micros = struct.unpack_from("<qq", reply, 24)
        sequence, _, offset, _, length = struct.unpack_from("<5I", reply, 56)
        return Frame(index, used, flags, seconds * 1_000_000 + micros, sequence, offset, length)

    def query(self, index: int) -> Frame:
        return self._buffer(QUERYBUF, index)

    def queue(self, index: int) -> Frame:
        return self._buffer(QBUF, index)

    def dequeue(self) -> Frame:
        return self._buffer(DQBUF, 0)

    def stream_on(self) -> None:
        self.ask(STREAMON, struct.pack("<I", 1))

    def stream_off(self) -> None:
        self.ask(STREAMOFF, struct.pack("<I", 1))

    def start(self, buffer_count: int) -> None:
        """Request buffers, queue all of them, let frames flow."""
        for index in range(self.request_buffers(buffer_count)):
            self.queue(index)
        self.stream_on()

    def get(self, cid: int) -> int:
        reply = self.ask(G_CTRL, struct.pack("<Ii", cid, 0))
        return int.from_bytes(reply[4:], "little", signed=True)

    def set(self, cid: int, value: int) -> int:
        reply = self.ask(S_CTRL, struct.pack("<Ii", cid, value))
        return int.from_bytes(reply[4:], "little", signed=True)
