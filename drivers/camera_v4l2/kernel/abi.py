"""Transcript of the V4L2 interface as far as one capture camera needs it: numbers and structs.

Source: linux/videodev2.h and linux/v4l2-controls.h, with the meaning of each field from the
kernel's "Video for Linux API" (userspace-api/media/v4l). Layouts are those of a 64-bit
little-endian Linux; a request number contains the size of its struct, so any other machine
answers ENOTTY instead of misreading. Bytes in, values out: nothing here opens a device.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final, Self

_WRITE: Final = 1  # asm-generic/ioctl.h: data travels to the kernel
_READ: Final = 2

_CAPABILITY: Final = struct.Struct("<16s32s32sIII12x")
_FMTDESC: Final = struct.Struct("<III32sI16x")
_PIX_FORMAT: Final = struct.Struct("<I4x12I152x")  # v4l2_format holding v4l2_pix_format
_REQUESTBUFFERS: Final = struct.Struct("<IIIIB3x")
_BUFFER: Final = struct.Struct("<IIIII4xqq16sIIQIII4x")
_STREAMPARM: Final = struct.Struct("<I6I176x")  # v4l2_streamparm holding v4l2_captureparm
_CONTROL: Final = struct.Struct("<Ii")
_QUERYCTRL: Final = struct.Struct("<II32siiiiI8x")
_QUERYMENU: Final = struct.Struct("<II32s4x")
_INT: Final = struct.Struct("<i")


def _request(direction: int, number: int, layout: struct.Struct) -> int:
    return direction << 30 | layout.size << 16 | ord("V") << 8 | number


VIDIOC_QUERYCAP: Final = _request(_READ, 0, _CAPABILITY)
VIDIOC_ENUM_FMT: Final = _request(_READ | _WRITE, 2, _FMTDESC)
VIDIOC_S_FMT: Final = _request(_READ | _WRITE, 5, _PIX_FORMAT)
VIDIOC_REQBUFS: Final = _request(_READ | _WRITE, 8, _REQUESTBUFFERS)
VIDIOC_QUERYBUF: Final = _request(_READ | _WRITE, 9, _BUFFER)
VIDIOC_QBUF: Final = _request(_READ | _WRITE, 15, _BUFFER)
VIDIOC_DQBUF: Final = _request(_READ | _WRITE, 17, _BUFFER)
VIDIOC_STREAMON: Final = _request(_WRITE, 18, _INT)
VIDIOC_STREAMOFF: Final = _request(_WRITE, 19, _INT)
VIDIOC_S_PARM: Final = _request(_READ | _WRITE, 22, _STREAMPARM)
VIDIOC_G_CTRL: Final = _request(_READ | _WRITE, 27, _CONTROL)
VIDIOC_S_CTRL: Final = _request(_READ | _WRITE, 28, _CONTROL)
VIDIOC_QUERYCTRL: Final = _request(_READ | _WRITE, 36, _QUERYCTRL)
VIDIOC_QUERYMENU: Final = _request(_READ | _WRITE, 37, _QUERYMENU)

BUF_TYPE_VIDEO_CAPTURE: Final = 1  # enum v4l2_buf_type
MEMORY_MMAP: Final = 1  # enum v4l2_memory
FIELD_ANY: Final = 0  # enum v4l2_field
FIELD_NONE: Final = 1  # progressive
CAP_TIMEPERFRAME: Final = 0x1000  # v4l2_captureparm.capability: the frame rate can be set


class Cap(IntFlag):
    """A node's capabilities (``V4L2_CAP_*``)."""

    VIDEO_CAPTURE = 0x00000001
    VIDEO_OUTPUT = 0x00000002
    VIDEO_OVERLAY = 0x00000004
    VBI_CAPTURE = 0x00000010
    VIDEO_CAPTURE_MPLANE = 0x00001000
    VIDEO_OUTPUT_MPLANE = 0x00002000
    VIDEO_M2M_MPLANE = 0x00004000
    VIDEO_M2M = 0x00008000
    TUNER = 0x00010000
    AUDIO = 0x00020000
    RADIO = 0x00040000
    SDR_CAPTURE = 0x00100000
    EXT_PIX_FORMAT = 0x00200000
    META_CAPTURE = 0x00800000
    READWRITE = 0x01000000
    STREAMING = 0x04000000
    META_OUTPUT = 0x08000000
    TOUCH = 0x10000000
    DEVICE_CAPS = 0x80000000  # `device_caps` is filled in


class BufFlag(IntFlag):
    """State of a buffer (``V4L2_BUF_FLAG_*``)."""

    MAPPED = 0x00000001
    QUEUED = 0x00000002
    DONE = 0x00000004
    ERROR = 0x00000040  # the data may be corrupted; the buffer is handed out all the same


TIMESTAMP_MASK: Final = 0x0000E000
TIMESTAMP_MONOTONIC: Final = 0x00002000
TSTAMP_SRC_MASK: Final = 0x00070000
TSTAMP_SRC_EOF: Final = 0x00000000
TSTAMP_SRC_SOE: Final = 0x00010000


class ControlId(IntEnum):
    """Controls this driver touches (``V4L2_CID_*``); names differ between kernels, ids do not."""

    WHITE_BALANCE_AUTOMATIC = 0x0098090C
    GAIN_AUTOMATIC = 0x00980912
    GAIN = 0x00980913
    WHITE_BALANCE_TEMPERATURE = 0x0098091A  # kelvin
    AUTO_EXPOSURE = 0x009A0901
    EXPOSURE_TIME_ABSOLUTE = 0x009A0902  # units of 100 µs
    EXPOSURE_AUTO_PRIORITY = 0x009A0903  # 1: the frame rate may drop for a longer exposure
    FOCUS_AUTOMATIC = 0x009A090C


EXPOSURE_MANUAL: Final = 1  # enum v4l2_exposure_auto_type
EXPOSURE_UNIT_S: Final = 100e-6


class ControlType(IntEnum):
    """Kind of a control (``V4L2_CTRL_TYPE_*``)."""

    INTEGER = 1
    BOOLEAN = 2
    MENU = 3
    BUTTON = 4
    INTEGER64 = 5
    CTRL_CLASS = 6
    STRING = 7
    BITMASK = 8
    INTEGER_MENU = 9


class ControlFlag(IntFlag):
    """State of a control (``V4L2_CTRL_FLAG_*``)."""

    DISABLED = 0x0001
    GRABBED = 0x0002
    READ_ONLY = 0x0004
    INACTIVE = 0x0010
    WRITE_ONLY = 0x0040
    VOLATILE = 0x0080


CTRL_FLAG_NEXT_CTRL: Final = 0x80000000  # flag beside an id: "the first control above it"


def fourcc(name: str) -> int:
    """Return the code of a pixel format named by its four letters; trailing blanks may miss.

    Raises
    ------
    ValueError : not one to four ASCII letters
    """
    if not 1 <= len(name) <= 4 or not name.isascii():
        raise ValueError(f"a FourCC has one to four ASCII letters, not {name!r}")
    return int.from_bytes(name.ljust(4).encode("ascii"), "little")


def fourcc_name(code: int) -> str:
    """Return the letters of a FourCC without trailing blanks."""
    return code.to_bytes(4, "little").decode("latin-1").rstrip(" \0")


def _text(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace")


@dataclass(frozen=True, slots=True)
class Capability:
    """``struct v4l2_capability``."""

    driver: str
    card: str
    bus_info: str
    version: int
    capabilities: int
    device_caps: int

    @staticmethod
    def query() -> bytearray:
        """Return the empty struct that VIDIOC_QUERYCAP fills in."""
        return bytearray(_CAPABILITY.size)

    @classmethod
    def unpack(cls, raw: bytes | bytearray) -> Self:
        """Return the struct in the bytes."""
        driver, card, bus, version, caps, device_caps = _CAPABILITY.unpack(raw)
        return cls(_text(driver), _text(card), _text(bus), version, caps, device_caps)

    @property
    def node_caps(self) -> Cap:
        """The capabilities of this node, as against all nodes of the device together."""
        has_own = self.capabilities & Cap.DEVICE_CAPS
        return Cap(self.device_caps if has_own else self.capabilities)


def pack_fmtdesc(index: int) -> bytearray:
    """Return ``struct v4l2_fmtdesc`` asking for the format with this number."""
    return bytearray(_FMTDESC.pack(index, BUF_TYPE_VIDEO_CAPTURE, 0, b"", 0))


def unpack_fmtdesc(raw: bytes | bytearray) -> int:
    """Return the FourCC code in a filled ``struct v4l2_fmtdesc``."""
    return int(_FMTDESC.unpack(raw)[4])


@dataclass(frozen=True, slots=True)
class PixFormat:
    """``struct v4l2_pix_format``: the format of every picture [px, bytes]."""

    width: int
    height: int
    pixelformat: int
    field: int = FIELD_NONE
    bytesperline: int = 0
    sizeimage: int = 0

    def pack(self) -> bytearray:
        """Return ``struct v4l2_format`` asking for this."""
        values = (self.width, self.height, self.pixelformat, self.field)
        return bytearray(
            _PIX_FORMAT.pack(
                BUF_TYPE_VIDEO_CAPTURE, *values, self.bytesperline, self.sizeimage, *[0] * 6
            )
        )

    @classmethod
    def unpack(cls, raw: bytes | bytearray) -> Self:
        """Return the pixel format in ``struct v4l2_format``."""
        return cls(*_PIX_FORMAT.unpack(raw)[1:7])


def pack_requestbuffers(count: int) -> bytearray:
    """Return ``struct v4l2_requestbuffers`` for mapped capture buffers; 0 frees them."""
    return bytearray(_REQUESTBUFFERS.pack(count, BUF_TYPE_VIDEO_CAPTURE, MEMORY_MMAP, 0, 0))


def unpack_requestbuffers(raw: bytes | bytearray) -> int:
    """Return the number of buffers granted."""
    return int(_REQUESTBUFFERS.unpack(raw)[0])


@dataclass(frozen=True, slots=True)
class Buffer:
    """``struct v4l2_buffer`` of a mapped capture buffer."""

    index: int
    bytesused: int
    flags: int
    timestamp_us: int
    sequence: int
    offset: int
    length: int

    @staticmethod
    def query(index: int = 0) -> bytearray:
        """Return the struct that QUERYBUF, QBUF and DQBUF take."""
        return bytearray(
            _BUFFER.pack(
                index, BUF_TYPE_VIDEO_CAPTURE, 0, 0, 0, 0, 0, b"", 0, MEMORY_MMAP, 0, 0, 0, 0
            )
        )

    @classmethod
    def unpack(cls, raw: bytes | bytearray) -> Self:
        """Return the struct in the bytes; the time stamp stays in whole microseconds."""
        fields = _BUFFER.unpack(raw)
        index, _, bytesused, flags, _, seconds, microseconds, _, sequence, _, m, length = fields[
            :12
        ]
        offset = m & 0xFFFFFFFF  # `m` is a union: an mmap offset is its first 32 bits
        stamp_us = seconds * 1_000_000 + microseconds
        return cls(index, bytesused, flags, stamp_us, sequence, offset, length)


def restamp(raw: bytearray, stamp_us: int, *, is_bad: bool) -> None:
    """Give a ``struct v4l2_buffer`` another time stamp, and flag its picture as bad.

    Parameters
    ----------
    raw : the struct; changed in place
    stamp_us : the time stamp [microseconds]
    is_bad : set ``V4L2_BUF_FLAG_ERROR``
    """
    fields = list(_BUFFER.unpack(raw))
    fields[5], fields[6] = divmod(stamp_us, 1_000_000)
    if is_bad:
        fields[3] |= BufFlag.ERROR
    raw[:] = _BUFFER.pack(*fields)


def pack_stream_type() -> bytearray:
    """Return the argument of STREAMON and STREAMOFF."""
    return bytearray(_INT.pack(BUF_TYPE_VIDEO_CAPTURE))


def pack_streamparm(numerator: int, denominator: int) -> bytearray:
    """Return ``struct v4l2_streamparm`` asking for numerator/denominator seconds a frame."""
    return bytearray(_STREAMPARM.pack(BUF_TYPE_VIDEO_CAPTURE, 0, 0, numerator, denominator, 0, 0))


def unpack_streamparm(raw: bytes | bytearray) -> float | None:
    """Return the frame period [s] that came back, None if the camera names none."""
    _, _, _, numerator, denominator, _, _ = _STREAMPARM.unpack(raw)
    return numerator / denominator if numerator and denominator else None


def pack_control(control: int, value: int = 0) -> bytearray:
    """Return ``struct v4l2_control``."""
    return bytearray(_CONTROL.pack(control, value))


def unpack_control(raw: bytes | bytearray) -> int:
    """Return the value in ``struct v4l2_control``."""
    return int(_CONTROL.unpack(raw)[1])


@dataclass(frozen=True, slots=True)
class QueryCtrl:
    """``struct v4l2_queryctrl``: kind, range and state of a control, in its own units."""

    control: int
    type: int
    name: str
    minimum: int
    maximum: int
    step: int
    default: int
    flags: int

    @staticmethod
    def query(control: int) -> bytearray:
        """Return the struct asking about a control (or, with NEXT_CTRL, the next above it)."""
        return bytearray(_QUERYCTRL.pack(control, 0, b"", 0, 0, 0, 0, 0))

    @classmethod
    def unpack(cls, raw: bytes | bytearray) -> Self:
        """Return the struct in the bytes."""
        control, kind, name, *rest = _QUERYCTRL.unpack(raw)
        return cls(control, kind, _text(name), *rest)


def pack_querymenu(control: int, index: int) -> bytearray:
    """Return ``struct v4l2_querymenu``."""
    return bytearray(_QUERYMENU.pack(control, index, b""))


def unpack_querymenu(raw: bytes | bytearray, kind: int) -> str:
    """Return the text of a menu item; an integer menu's number as text."""
    name: bytes = _QUERYMENU.unpack(raw)[2]
    if kind == ControlType.INTEGER_MENU:
        return str(int.from_bytes(name[:8], "little", signed=True))
    return _text(name)
