"""Pixel formats: the cell file's names, those of GenICam, and how a picture is read.

Names and numbers are those of the Pixel Format Naming Convention (EMVA, PFNC 2.x): grey levels
without packing, in the low bits of one or two bytes, the low byte first.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.errors import BadReplyError
from messages import say

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """A format of grey pictures.

    Attributes
    ----------
    name : name in GenICam
    number : number in GenICam, which comes with each frame
    bits : depth of a pixel [bits]
    """

    name: str
    number: int
    bits: int

    @property
    def white(self) -> int:
        """The largest value a pixel can have."""
        return (1 << self.bits) - 1

    @property
    def item_bytes(self) -> int:
        """Size of a pixel [bytes]."""
        return 1 if self.bits == 8 else 2


# what a cell file calls it, as it does for V4L2 cameras
FORMATS: Final = {
    "GREY": PixelFormat("Mono8", 0x01080001, 8),
    "Y10": PixelFormat("Mono10", 0x01100003, 10),
    "Y12": PixelFormat("Mono12", 0x01100005, 12),
    "Y16": PixelFormat("Mono16", 0x01100007, 16),
}


def wanted_formats(names: tuple[str, ...]) -> tuple[PixelFormat, ...]:
    """Return the grey formats among a cell file's, in its order; colour and JPEG are passed over.

    Raises
    ------
    ValueError : there is none
    """
    found = tuple(FORMATS[name] for name in names if name in FORMATS)
    if not found:
        raise ValueError(
            f"pixel formats {', '.join(names)}: a GenICam camera sends {', '.join(FORMATS)}; name "
            "one of them"
        )
    return found


def decode(data: bytes, height: int, width: int, padding: int, item_bytes: int) -> Image:
    """Return a picture (height, width), read-only.

    Parameters
    ----------
    data : rows, one after the other
    height, width : of the picture [px]
    padding : bytes behind each row
    item_bytes : size of a pixel [bytes]

    Raises
    ------
    BadReplyError : it is shorter than its size makes it
    """
    stride = width * item_bytes + padding
    if len(data) < stride * height - padding:
        raise BadReplyError(
            say(
                "a picture of {width} x {height} px in {byte_count} bytes, "
                "{expected_count} expected",
                width=width,
                height=height,
                byte_count=len(data),
                expected_count=stride * height,
            )
        )
    rows = np.frombuffer(data.ljust(stride * height, b"\0"), np.uint8, stride * height)
    pixels = np.ascontiguousarray(rows.reshape(height, stride)[:, : width * item_bytes])
    image: Image = pixels if item_bytes == 1 else pixels.view("<u2").astype(np.uint16, copy=False)
    image.flags.writeable = False
    return image
