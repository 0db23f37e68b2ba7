"""The queue of frame buffers, by videobuf2's rules: owner, waiting calls, poll state.

Knows buffers by number and offset; a transport holds their bytes.
"""

import errno
from collections import deque
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from . import abi
from .abi import BufferFlag, Poll
from .handle import Handle, NotYet, Refused

# buffer i is at i * SLOT_BYTES, whatever the format, so that offsets never change
SLOT_BYTES: Final = 32 << 20
BUFFERS_MAX: Final = 8


class _State(Enum):
    CLIENTS = auto()  # dequeued: the client may read it
    QUEUED = auto()
    EXPOSING = auto()  # chosen for a frame whose picture is being made
    DONE = auto()


_STATE_FLAGS: Final = {
    _State.CLIENTS: 0,
    _State.QUEUED: BufferFlag.QUEUED,
    _State.EXPOSING: BufferFlag.QUEUED,
    _State.DONE: BufferFlag.DONE,
}


@dataclass(slots=True, eq=False)
class Buffer:
    """One frame buffer and its client's data on the frame in it."""

    index: int
    state: _State = _State.CLIENTS
    used_bytes: int = 0
    flags: int = BufferFlag.TIMESTAMP_MONOTONIC
    timestamp_us: int = 0
    sequence: int = 0


class BufferQueue:
    """All buffers that one REQBUFS made, until the next.

    Attributes
    ----------
    owner : the open file that asked for the buffers; all others get EBUSY
    """

    def __init__(self) -> None:
        self.owner: Handle | None = None
        self.is_streaming = False
        self._room_bytes = 0
        self._buffers: list[Buffer] = []
        self._queued: deque[Buffer] = deque()
        self._done: deque[Buffer] = deque()
        self._was_fed = False  # a buffer was queued since the stream last stopped

    @property
    def are_allocated(self) -> bool:
        """Whether buffers exist, which forbids a change of format."""
        return bool(self._buffers)

    @property
    def has_queued(self) -> bool:
        """Whether the next frame has somewhere to go."""
        return bool(self._queued)

    def poll(self) -> int:
        """Return the bits that poll(2) reports, except those of events."""
        if not self.is_streaming:
            return Poll.ERR
        if self._done:
            return Poll.IN | Poll.RDNORM
        return 0 if self._was_fed else Poll.ERR

    # -- the sensor's side ----------------------------------------------------------------

    def take(self) -> Buffer:
        """Take the buffer queued first and return it; it comes back by `finish` or `give_back`."""
        buffer = self._queued.popleft()
        buffer.state = _State.EXPOSING
        return buffer

    def give_back(self, buffer: Buffer) -> None:
        """Queue a taken buffer again, first in line: its frame is lost."""
        buffer.state = _State.QUEUED
        self._queued.appendleft(buffer)

    def finish(
        self, buffer: Buffer, used_bytes: int, flags: int, timestamp_us: int, sequence: int
    ) -> None:
        """Give a taken buffer, filled, to the client.

        Parameters
        ----------
        buffer : one that was taken from the queue for this frame
        used_bytes : length of the picture [bytes]
        flags : `BufferFlag` bits, such as ERROR for a broken picture
        timestamp_us : instant of the frame, on the clock that the flags name
        sequence : number of the frame; lost frames leave a gap
        """
        buffer.used_bytes, buffer.flags = used_bytes, flags
        buffer.timestamp_us, buffer.sequence = timestamp_us, sequence
        buffer.state = _State.DONE
        self._done.append(buffer)

    def stop(self) -> None:
        """End the stream: all buffers are the client's again and their frames are lost."""
        self.is_streaming = self._was_fed = False
        self._queued.clear()
        self._done.clear()
        for buffer in self._buffers:
            buffer.state = _State.CLIENTS

    def release(self, handle: Handle | None) -> None:
        """Free all buffers if this open file owns them; None frees them in any case."""
        if handle is None or handle is self.owner:
            self.stop()
            self._buffers, self.owner = [], None

    # -- ioctls -----------------------------------------------------------------------------

    def reqbufs(self, handle: Handle, data: bytearray, room_bytes: int) -> None:
        """Answer VIDIOC_REQBUFS; each buffer holds `room_bytes`.

        Parameters
        ----------
        handle : the open file that asks; it owns the buffers from then on
        data : the struct v4l2_requestbuffers, answered in place
        room_bytes : size of each buffer [bytes]

        Raises
        ------
        Refused : EINVAL, no capture by mmap; EBUSY, while frames flow or another file owns the
            buffers
        """
        count, kind, memory, _, _ = abi.REQUESTBUFFERS.unpack(data)
        if kind != abi.BUF_TYPE_VIDEO_CAPTURE or memory != abi.MEMORY_MMAP:
            raise Refused(errno.EINVAL)
        self._demand_owner(handle)
        if self.is_streaming:
            raise Refused(errno.EBUSY)
        self._room_bytes = room_bytes
        self.stop()
        self._buffers = [Buffer(index) for index in range(min(count, BUFFERS_MAX))]
        self.owner = handle if self._buffers else None
        data[:] = abi.REQUESTBUFFERS.pack(
            len(self._buffers), kind, memory, abi.BUF_CAP_SUPPORTS_MMAP, 0
        )

    def querybuf(self, data: bytearray) -> None:
        """Answer VIDIOC_QUERYBUF."""
        self._describe(self._buffer_of(data), data)

    def qbuf(self, handle: Handle, data: bytearray) -> None:
        """Answer VIDIOC_QBUF.

        Raises
        ------
        Refused : EINVAL, no such buffer, not by mmap, or queued already; EBUSY, another file owns
            the buffers
        """
        buffer = self._buffer_of(data)
        self._demand_owner(handle)
        if abi.BUFFER.unpack(data)[9] != abi.MEMORY_MMAP or buffer.state is not _State.CLIENTS:
            raise Refused(errno.EINVAL)
        buffer.state = _State.QUEUED
        buffer.flags &= ~BufferFlag.ERROR
        self._queued.append(buffer)
        self._was_fed = True
        self._describe(buffer, data)

    def dqbuf(self, handle: Handle, data: bytearray, *, is_blocking: bool) -> None:
        """Answer VIDIOC_DQBUF.

        Parameters
        ----------
        handle : the open file that asks
        data : the struct v4l2_buffer, answered in place
        is_blocking : the file was opened without O_NONBLOCK

        Raises
        ------
        NotYet : no frame is finished, and the client waits for one
        Refused : EAGAIN, no frame is finished; EINVAL, no capture by mmap, or no frames flow;
            EBUSY, another file owns the buffers
        """
        fields = abi.BUFFER.unpack(data)
        if fields[1] != abi.BUF_TYPE_VIDEO_CAPTURE or fields[9] != abi.MEMORY_MMAP:
            raise Refused(errno.EINVAL)
        self._demand_owner(handle)
        if not self.is_streaming:
            raise Refused(errno.EINVAL)
        if not self._done:
            raise NotYet if is_blocking else Refused(errno.EAGAIN)
        buffer = self._done.popleft()
        buffer.state = _State.CLIENTS
        self._describe(buffer, data)

    def streamon(self, handle: Handle, data: bytearray) -> bool:
        """Answer VIDIOC_STREAMON; return True if frames start now.

        Raises
        ------
        Refused : EINVAL, not a capture or no buffers; EBUSY, another file owns the buffers
        """
        if abi.U32.unpack(data)[0] != abi.BUF_TYPE_VIDEO_CAPTURE:
            raise Refused(errno.EINVAL)
        self._demand_owner(handle)
        if not self._buffers:
            raise Refused(errno.EINVAL)
        starts, self.is_streaming = not self.is_streaming, True
        return starts

    def streamoff(self, handle: Handle, data: bytearray) -> None:
        """Answer VIDIOC_STREAMOFF.

        Raises
        ------
        Refused : EINVAL, not a capture; EBUSY, another file owns the buffers
        """
        if abi.U32.unpack(data)[0] != abi.BUF_TYPE_VIDEO_CAPTURE:
            raise Refused(errno.EINVAL)
        self._demand_owner(handle)
        self.stop()

    def may_map(self, length_bytes: int, offset_bytes: int) -> bool:
        """Return whether an mmap(2) range is one buffer's."""
        index, rest = divmod(offset_bytes, SLOT_BYTES)
        return rest == 0 and index < len(self._buffers) and 0 < length_bytes <= SLOT_BYTES

    def _demand_owner(self, handle: Handle) -> None:
        if self.owner not in (None, handle):
            raise Refused(errno.EBUSY)

    def _buffer_of(self, data: bytearray) -> Buffer:
        index, kind = abi.BUFFER.unpack(data)[:2]
        if kind != abi.BUF_TYPE_VIDEO_CAPTURE or index >= len(self._buffers):
            raise Refused(errno.EINVAL)
        buffer: Buffer = self._buffers[index]
        return buffer

    def _describe(self, buffer: Buffer, data: bytearray) -> None:
        seconds, microseconds = divmod(buffer.timestamp_us, 1_000_000)
        data[:] = abi.BUFFER.pack(
            buffer.index,
            abi.BUF_TYPE_VIDEO_CAPTURE,
            buffer.used_bytes,
            buffer.flags | BufferFlag.MAPPED | _STATE_FLAGS[buffer.state],
            abi.FIELD_NONE,
            seconds,
            microseconds,
            b"",
            buffer.sequence & 0xFFFFFFFF,
            abi.MEMORY_MMAP,
            buffer.index * SLOT_BYTES,
            self._room_bytes,
            0,
            0,
        )
