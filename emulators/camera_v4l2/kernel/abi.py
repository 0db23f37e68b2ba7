"""V4L2 in numbers: requests, struct layouts and flags of `linux/videodev2.h` on 64-bit Linux.

Written after the kernel's header alone; a test compiles the header, where there is one, and
compares. Knows layouts, not the behaviour of a camera.
"""

from enum import IntEnum
from struct import Struct
from typing import Final

_WRITE, _READ = 1, 2  # directions as the client sees them, asm-generic/ioctl.h


def _request(direction: int, number: int, size_bytes: int) -> int:
    return direction << 30 | size_bytes << 16 | ord("V") << 8 | number


def size_of_request(request: int) -> int:
    """Return the size in bytes of a request's struct (the header's `_IOC_SIZE`)."""
    return request >> 16 & 0x3FFF


class Request(IntEnum):
    """The supported ioctls; any other is answered ENOTTY."""

    QUERYCAP = _request(_READ, 0, 104)
    ENUM_FMT = _request(_READ | _WRITE, 2, 64)
    G_FMT = _request(_READ | _WRITE, 4, 208)
    S_FMT = _request(_READ | _WRITE, 5, 208)
    REQBUFS = _request(_READ | _WRITE, 8, 20)
    QUERYBUF = _request(_READ | _WRITE, 9, 88)
    QBUF = _request(_READ | _WRITE, 15, 88)
    DQBUF = _request(_READ | _WRITE, 17, 88)
    STREAMON = _request(_WRITE, 18, 4)
    STREAMOFF = _request(_WRITE, 19, 4)
    G_PARM = _request(_READ | _WRITE, 21, 204)
    S_PARM = _request(_READ | _WRITE, 22, 204)
    ENUMINPUT = _request(_READ | _WRITE, 26, 80)
    G_CTRL = _request(_READ | _WRITE, 27, 8)
    S_CTRL = _request(_READ | _WRITE, 28, 8)
    QUERYCTRL = _request(_READ | _WRITE, 36, 68)
    QUERYMENU = _request(_READ | _WRITE, 37, 44)
    G_INPUT = _request(_READ, 38, 4)
    S_INPUT = _request(_READ | _WRITE, 39, 4)
    TRY_FMT = _request(_READ | _WRITE, 64, 208)
    G_PRIORITY = _request(_READ, 67, 4)
    S_PRIORITY = _request(_WRITE, 68, 4)
    G_EXT_CTRLS = _request(_READ | _WRITE, 71, 32)
    S_EXT_CTRLS = _request(_READ | _WRITE, 72, 32)
    TRY_EXT_CTRLS = _request(_READ | _WRITE, 73, 32)
    ENUM_FRAMESIZES = _request(_READ | _WRITE, 74, 44)
    ENUM_FRAMEINTERVALS = _request(_READ | _WRITE, 75, 52)
    DQEVENT = _request(_READ, 89, 136)
    SUBSCRIBE_EVENT = _request(_WRITE, 90, 32)
    UNSUBSCRIBE_EVENT = _request(_WRITE, 91, 32)
    QUERY_EXT_CTRL = _request(_READ | _WRITE, 103, 232)


NEEDS_PRIORITY: Final = frozenset(
    {
        Request.S_FMT,
        Request.REQBUFS,
        Request.STREAMON,
        Request.STREAMOFF,
        Request.S_PARM,
        Request.S_CTRL,
        Request.S_EXT_CTRLS,
        Request.S_INPUT,
        Request.S_PRIORITY,
    }
)  # those that the kernel refuses while another handle holds a higher priority (INFO_FL_PRIO)

U32: Final = Struct("<I")
CAPABILITY: Final = Struct("<16s32s32sIII12x")  # driver card bus_info version caps device_caps
FMTDESC: Final = Struct("<III32sII12x")  # index type flags description fourcc mbus_code
FORMAT: Final = Struct("<I4x12I152x")  # type, then the twelve words of v4l2_pix_format
REQUESTBUFFERS: Final = Struct("<IIIIB3x")  # count type memory capabilities flags
BUFFER: Final = Struct("<5I4xqq16sIIQIII4x")
# index type bytesused flags field | timestamp s, us | timecode | sequence memory offset length ..
STREAMPARM: Final = Struct("<7I176x")  # type capability mode numerator denominator ext readbuffers
INPUT: Final = Struct("<I32sIIIQII16x")  # index name type audioset tuner std status capabilities
CONTROL: Final = Struct("<Ii")
QUERYCTRL: Final = Struct("<II32siiiiI8x")  # id type name min max step default flags
QUERYMENU: Final = Struct("<II32s4x")  # id index name
QUERY_EXT_CTRL: Final = Struct("<II32sqqQqIIII144x")  # .. as QUERYCTRL, elem_size elems dims
EXT_CONTROLS: Final = Struct("<5I4xQ")  # which count error_idx request_fd reserved pointer
EXT_CONTROL: Final = Struct("<IIIq")  # id size reserved value64 (its low half is the value)
FRMSIZEENUM: Final = Struct("<5I24x")  # index fourcc type width height
FRMIVALENUM: Final = Struct("<7I24x")  # index fourcc width height type numerator denominator
EVENT_SUBSCRIPTION: Final = Struct("<III20x")  # type id flags
EVENT: Final = Struct("<I4x64sIIqqI36x")  # type payload pending sequence s ns id
EVENT_CTRL: Final = Struct("<IIqIiiii")  # changes type value flags min max step default

BUF_TYPE_VIDEO_CAPTURE: Final = 1
MEMORY_MMAP: Final = 1
FIELD_NONE: Final = 1
COLORSPACE_JPEG: Final = 7
COLORSPACE_SRGB: Final = 8
PIX_FMT_PRIV_MAGIC: Final = 0xFEEDCAFE
FMT_FLAG_COMPRESSED: Final = 1
CAP_VIDEO_CAPTURE: Final = 0x00000001
CAP_EXT_PIX_FORMAT: Final = 0x00200000
CAP_STREAMING: Final = 0x04000000
CAP_DEVICE_CAPS: Final = 0x80000000
CAP_TIMEPERFRAME: Final = 0x1000
BUF_CAP_SUPPORTS_MMAP: Final = 1
INPUT_TYPE_CAMERA: Final = 2
FRMSIZE_TYPE_DISCRETE: Final = 1
FRMIVAL_TYPE_DISCRETE: Final = 1
PRIORITY_BACKGROUND, PRIORITY_INTERACTIVE, PRIORITY_RECORD = 1, 2, 3


class BufferFlag(IntEnum):
    """Bits of `v4l2_buffer.flags`."""

    MAPPED = 0x1
    QUEUED = 0x2
    DONE = 0x4
    ERROR = 0x40
    TIMESTAMP_MONOTONIC = 0x2000
    TSTAMP_SRC_SOE = 0x10000


class Poll(IntEnum):
    """Bits of poll(2), asm-generic/poll.h."""

    IN = 0x1
    PRI = 0x2
    ERR = 0x8
    HUP = 0x10
    RDNORM = 0x40


def fourcc(name: str) -> int:
    """Return a pixel format's code, e.g. of "GREY" or "Y16 "."""
    return int.from_bytes(name.ljust(4).encode("ascii"), "little")
