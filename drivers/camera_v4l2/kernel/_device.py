"""One open V4L2 node as typed calls. Blocking; ``OSError`` passes through unchanged."""

import errno
from collections.abc import Iterator
from fractions import Fraction
from typing import Final

from . import abi
from ._syscalls import BufferMap, SysCalls

_MAX_LISTED: Final = 256  # a camera whose lists have no end must not hang the cell


class Device:
    """An open node.

    Parameters
    ----------
    calls : caller of system calls
    path : path to open
    """

    def __init__(self, calls: SysCalls, path: str) -> None:
        self.path = path
        self._calls = calls
        self._fd = calls.open(path)

    def close(self) -> None:
        """Close the node; the object cannot be used again."""
        self._calls.close(self._fd)

    def readiness_fd(self) -> int:
        """Return the descriptor to wait on."""
        return self._calls.readiness_fd(self._fd)

    def acknowledge(self) -> None:
        """Forget any readiness so far."""
        self._calls.acknowledge(self._fd)

    def mmap(self, length: int, offset: int) -> BufferMap:
        """Return the map of one buffer."""
        return self._calls.mmap(self._fd, length, offset)

    def query_capability(self) -> abi.Capability:
        """Return name, driver and capabilities."""
        return abi.Capability.unpack(self._ask(abi.VIDIOC_QUERYCAP, abi.Capability.query()))

    def pixel_formats(self) -> Iterator[int]:
        """Yield the FourCC codes the camera offers."""
        for index in range(_MAX_LISTED):
            try:
                yield abi.unpack_fmtdesc(self._ask(abi.VIDIOC_ENUM_FMT, abi.pack_fmtdesc(index)))
            except OSError as error:
                if error.errno == errno.EINVAL:  # the list's end
                    return
                raise

    def set_format(self, wanted: abi.PixFormat) -> abi.PixFormat:
        """Set a format; return the one the camera will send."""
        return abi.PixFormat.unpack(self._ask(abi.VIDIOC_S_FMT, wanted.pack()))

    def set_period(self, period_s: float) -> float | None:
        """Set a frame period [s]; return the one granted, None if the camera names none."""
        wanted = Fraction(period_s).limit_denominator(100_000)
        struct = abi.pack_streamparm(wanted.numerator, wanted.denominator)
        return abi.unpack_streamparm(self._ask(abi.VIDIOC_S_PARM, struct))

    def request_buffers(self, count: int) -> int:
        """Order mapped buffers (0: free them); return their number."""
        struct = abi.pack_requestbuffers(count)
        return abi.unpack_requestbuffers(self._ask(abi.VIDIOC_REQBUFS, struct))

    def query_buffer(self, index: int) -> abi.Buffer:
        """Return the place of a buffer."""
        return abi.Buffer.unpack(self._ask(abi.VIDIOC_QUERYBUF, abi.Buffer.query(index)))

    def queue(self, index: int) -> None:
        """Give a buffer to the camera."""
        self._ask(abi.VIDIOC_QBUF, abi.Buffer.query(index))

    def dequeue(self) -> abi.Buffer | None:
        """Take the oldest finished buffer and return it, None if there is none."""
        try:
            return abi.Buffer.unpack(self._ask(abi.VIDIOC_DQBUF, abi.Buffer.query()))
        except BlockingIOError:
            return None

    def stream_on(self) -> None:
        """Start the frames."""
        self._ask(abi.VIDIOC_STREAMON, abi.pack_stream_type())

    def stream_off(self) -> None:
        """Stop the frames; every buffer is ours again."""
        self._ask(abi.VIDIOC_STREAMOFF, abi.pack_stream_type())

    def query_control(self, control: int) -> abi.QueryCtrl | None:
        """Return a control's name and range; None if the camera has no such control."""
        try:
            raw = self._ask(abi.VIDIOC_QUERYCTRL, abi.QueryCtrl.query(control))
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY):  # ENOTTY: no controls at all
                return None
            raise
        found = abi.QueryCtrl.unpack(raw)
        return None if found.flags & abi.ControlFlag.DISABLED else found

    def list_controls(self) -> Iterator[abi.QueryCtrl]:
        """Yield every control, in the order of their ids."""
        last = 0
        for _ in range(_MAX_LISTED):
            try:
                query = abi.QueryCtrl.query(last | abi.CTRL_FLAG_NEXT_CTRL)
                found = abi.QueryCtrl.unpack(self._ask(abi.VIDIOC_QUERYCTRL, query))
            except OSError as error:
                if error.errno in (errno.EINVAL, errno.ENOTTY):  # the list's end
                    return
                raise
            last = found.control
            if not found.flags & abi.ControlFlag.DISABLED:
                yield found

    def menu_items(self, control: abi.QueryCtrl) -> Iterator[tuple[int, str]]:
        """Yield number and text of a menu's items; numbers may be missing."""
        for index in range(control.minimum, min(control.maximum, _MAX_LISTED) + 1):
            try:
                raw = self._ask(abi.VIDIOC_QUERYMENU, abi.pack_querymenu(control.control, index))
            except OSError as error:
                if error.errno == errno.EINVAL:
                    continue
                raise
            yield index, abi.unpack_querymenu(raw, control.type)

    def get_control(self, control: int) -> int:
        """Return the value of a control."""
        return abi.unpack_control(self._ask(abi.VIDIOC_G_CTRL, abi.pack_control(control)))

    def set_control(self, control: int, value: int) -> None:
        """Write a control."""
        self._ask(abi.VIDIOC_S_CTRL, abi.pack_control(control, value))

    def _ask(self, request: int, buffer: bytearray) -> bytearray:
        self._calls.ioctl(self._fd, request, buffer)
        return buffer
