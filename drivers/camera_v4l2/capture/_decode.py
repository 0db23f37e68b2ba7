"""Bytes of one buffer into a grey picture. Arrays in, arrays out: no device, no clock.

The format preferred is the one that says most about the light: GREY and Y10..Y16
are the sensor's numbers, YUYV's luma went through the camera's colour matrix, MJPG lost detail.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.pictures import BrokenPictureError
from drivers.pictures import decode as decode_picture
from messages import key, say

from ..kernel.abi import PixFormat, fourcc, fourcc_name

Image = NDArray[np.uint8] | NDArray[np.uint16]

_START_OF_IMAGE: Final = b"\xff\xd8"
_END_OF_IMAGE: Final = b"\xff\xd9"


@dataclass(frozen=True, slots=True)
class PixelKind:
    """The storage of grey values in a pixel format.

    Attributes
    ----------
    name : FourCC without trailing blanks
    bytes_per_px : bytes of a raw format; 0 for a compressed one
    bits : bits of one grey value; white is ``2**bits - 1``
    """

    name: str
    bytes_per_px: int
    bits: int


KINDS: Final = {
    kind.name: kind
    for kind in (
        PixelKind("GREY", 1, 8),
        PixelKind("Y10", 2, 10),
        PixelKind("Y12", 2, 12),
        PixelKind("Y16", 2, 16),
        PixelKind("YUYV", 2, 8),
        PixelKind("MJPG", 0, 8),
        PixelKind("JPEG", 0, 8),
    )
}


def pixel_kind(pixel_format: PixFormat) -> PixelKind | None:
    """Return the pixel kind of a format; None if this driver cannot read it."""
    return KINDS.get(fourcc_name(pixel_format.pixelformat))


def line_bytes(pixel_format: PixFormat) -> int:
    """Return the distance of two rows [bytes] of a raw format; some drivers say 0 for "packed"."""
    kind = KINDS[fourcc_name(pixel_format.pixelformat)]
    return pixel_format.bytesperline or pixel_format.width * kind.bytes_per_px


def check_complete(data: bytes, pixel_format: PixFormat) -> None:
    """Check that the bytes can be a whole picture.

    A raw picture has exactly ``sizeimage`` bytes; a JPEG starts with SOI and ends with EOI,
    behind which cameras leave zeros.

    Raises
    ------
    BrokenPictureError : a JPEG without its first or last marker, or a raw picture of another size;
        the message names which
    """
    if pixel_format.pixelformat in (fourcc("MJPG"), fourcc("JPEG")):
        if not data.startswith(_START_OF_IMAGE):
            raise BrokenPictureError(
                say("a JPEG that starts with {data}", data=data[:2].hex(" ") or "nothing")
            )
        if not data.rstrip(b"\0").endswith(_END_OF_IMAGE):
            raise BrokenPictureError(key("a JPEG without its end"))
        return
    if len(data) != pixel_format.sizeimage:
        raise BrokenPictureError(
            say(
                "{data_count} bytes of {sizeimage}",
                data_count=len(data),
                sizeimage=pixel_format.sizeimage,
            )
        )


def decode(data: bytes, pixel_format: PixFormat) -> Image:
    """Return the grey picture in one buffer.

    Parameters
    ----------
    data : the buffer's ``bytesused`` bytes
    pixel_format : reply of S_FMT

    Returns
    -------
    (height, width) uint8, or uint16 for Y10, Y12 and Y16; read-only, C-contiguous

    Raises
    ------
    BrokenPictureError : not a whole picture, or a JPEG of another size or that lost data
    """
    check_complete(data, pixel_format)
    kind = KINDS[fourcc_name(pixel_format.pixelformat)]
    image = _decode_jpeg(data) if kind.bytes_per_px == 0 else _decode_raw(data, pixel_format, kind)
    shape = (pixel_format.height, pixel_format.width)
    if image.shape != shape:
        raise BrokenPictureError(
            say("a JPEG of {width} x {height} px", width=image.shape[1], height=image.shape[0])
        )
    image.flags.writeable = False
    return image


def _decode_raw(data: bytes, pixel_format: PixFormat, kind: PixelKind) -> Image:
    stride, height = line_bytes(pixel_format), pixel_format.height
    used = pixel_format.width * kind.bytes_per_px
    rows = np.frombuffer(data, np.uint8, count=stride * height).reshape(height, stride)[:, :used]
    if kind.name == "YUYV":
        return np.ascontiguousarray(rows[:, 0::2])  # Y0 U Y1 V: every second byte is luma
    if kind.bits == 8:
        return np.ascontiguousarray(rows)
    words = np.ascontiguousarray(rows).view("<u2").astype(np.uint16, copy=False)
    if kind.bits < 16:  # the bits above the value are not promised to be clear
        words = words & np.uint16((1 << kind.bits) - 1)
    return words


def _decode_jpeg(data: bytes) -> NDArray[np.uint8]:
    return np.asarray(decode_picture(data, "grey"), np.uint8)
