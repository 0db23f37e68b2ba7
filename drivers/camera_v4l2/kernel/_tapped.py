"""System calls with a tap in between: recorded as they are made, or answered by a recording.

Which buffer is given back when is no matter of the camera's state, so QBUF leaves no trace; a DQBUF
leaves one if it brings a frame. All other ioctls are calls like `open`: in order, byte by byte.
"""

import os
from typing import Final

from drivers.wires import CameraTap
from messages import say

from . import abi
from ._syscalls import BufferMap, SysCalls

_NAMES: Final = {
    value: name
    for name, value in vars(abi).items()
    if name.startswith("VIDIOC_") and isinstance(value, int)
}


class TappedCalls:
    """Calls to a camera that pass through a tap.

    Parameters
    ----------
    calls : caller of system calls
    tap : tap that observes them, and may answer instead
    """

    def __init__(self, calls: SysCalls, tap: CameraTap) -> None:
        self._calls = calls
        self._tap = tap

    def open(self, path: str) -> int:
        """Open the camera; return its descriptor, -1 if a recording answers."""
        opened = -1

        def do() -> bytes:
            nonlocal opened
            opened = self._calls.open(path)
            return b""

        self._tap.call("open", b"", do)
        return opened

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> None:
        """Make the ioctl, or have the recording answer it.

        Parameters
        ----------
        fd : as `open` returned it
        request : the ioctl's request number
        buffer : the struct; changed in place
        """

        def do() -> bytes:
            answer = bytearray(buffer)
            self._calls.ioctl(fd, request, answer)
            return bytes(answer)

        if request == abi.VIDIOC_QBUF:
            self._tap.other(lambda: self._calls.ioctl(fd, request, buffer))
        elif request == abi.VIDIOC_DQBUF:
            taken = self._tap.dequeue(do, lambda raw: abi.Buffer.unpack(raw).timestamp_us)
            buffer[:] = taken.struct
            if taken.stamp_us is not None:
                abi.restamp(buffer, taken.stamp_us, is_bad=taken.is_unread)
        else:
            name = _NAMES.get(request, say("ioctl 0x{request:08X}", request=request))
            buffer[:] = self._tap.call(name, bytes(buffer), do)

    def mmap(self, fd: int, length: int, offset: int) -> BufferMap:
        """Return the map of one buffer.

        Parameters
        ----------
        fd : as `open` returned it
        length, offset : length and offset of the buffer [bytes], from QUERYBUF
        """
        inner: BufferMap | None = self._tap.other(lambda: self._calls.mmap(fd, length, offset))
        return _TappedMap(inner, self._tap)

    def readiness_fd(self, fd: int) -> int:
        """Return the descriptor to wait on."""
        return self._tap.readiness_fd(lambda: self._calls.readiness_fd(fd))

    def acknowledge(self, fd: int) -> None:
        """Forget any readiness so far."""
        self._tap.other(lambda: self._calls.acknowledge(fd))

    def close(self, fd: int) -> None:
        """Close the camera."""
        self._tap.other(lambda: self._calls.close(fd))


class _TappedMap:
    def __init__(self, inner: BufferMap | None, tap: CameraTap) -> None:
        self._inner = inner
        self._tap = tap

    def __getitem__(self, part: slice) -> bytes:
        def do() -> bytes:
            if self._inner is None:
                raise OSError(os.strerror(0))
            return self._inner[part]

        return self._tap.picture(do)

    def close(self) -> None:
        if self._inner is not None:
            self._inner.close()
