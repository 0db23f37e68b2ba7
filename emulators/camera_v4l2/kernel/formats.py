"""Pixel formats: the bytes of a sensor's picture on the wire, and their size."""

from enum import Enum
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from . import abi

Picture = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
_JPEG_QUALITY: Final = 95


class PixelFormat(Enum):
    """The formats that the camera can speak: fourcc, bytes per pixel, description.

    Y16 is little endian with its full scale at 65535; a source's 8-bit picture is scaled to it.
    """

    GREY = ("GREY", 1, "8-bit Greyscale")
    YUYV = ("YUYV", 2, "YUYV 4:2:2")
    MJPG = ("MJPG", 0, "Motion-JPEG")
    Y16 = ("Y16 ", 2, "16-bit Greyscale")

    @property
    def code(self) -> int:
        """The fourcc as V4L2 passes it."""
        return abi.fourcc(self.value[0])

    @property
    def is_compressed(self) -> bool:
        """Whether frames of one size differ in length."""
        return self is PixelFormat.MJPG

    @property
    def description(self) -> str:
        """The kernel's name for it."""
        return self.value[2]

    def bytes_per_line(self, width_px: int) -> int:
        """Return the length of a line [bytes]; zero for a compressed format."""
        return self.value[1] * width_px

    def frame_bytes(self, size_px: tuple[int, int]) -> int:
        """Return the room a frame of (width, height) needs [bytes]."""
        width, height = size_px
        return width * height * (self.value[1] or 2)  # a JPEG of noise is longer than its pixels


def bin_to(picture: Picture, size_px: tuple[int, int]) -> Picture:
    """Return the picture at (width, height), pixels averaged in whole groups.

    Raises
    ------
    ValueError : the picture is no whole multiple of the size in both directions alike
    """
    height, width = picture.shape
    if (width, height) == size_px:
        return picture
    factor = width // size_px[0]
    if factor < 1 or (width, height) != (size_px[0] * factor, size_px[1] * factor):
        raise ValueError(f"a picture of {width}×{height} px does not bin to {size_px} px")
    binned = cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA)
    return cast("Picture", binned)


def brighten(picture: Picture, offset: int) -> Picture:
    """Return the picture with `offset` (of 255, whatever its depth) added, clipped."""
    if offset == 0:
        return picture
    if picture.dtype == np.uint16:
        shifted = picture.astype(np.int32) + offset * 257
        return np.clip(shifted, 0, 65535).astype(np.uint16)
    return np.clip(picture.astype(np.int16) + offset, 0, 255).astype(np.uint8)


def mean_level(picture: Picture) -> float:
    """Return the mean brightness, 0 to 255, of a sparse sample of the picture."""
    sample = float(picture[::16, ::16].mean())
    return sample / 257.0 if picture.dtype == np.uint16 else sample


def encode(picture: Picture, pixel_format: PixelFormat) -> bytes | memoryview:
    """Return the bytes on the wire of a frame of this picture (height, width).

    Raises
    ------
    ValueError : OpenCV could not make a JPEG of it
    """
    if pixel_format is PixelFormat.Y16:
        deep = picture if picture.dtype == np.uint16 else picture.astype(np.uint16) * 257
        return _flat(deep.astype("<u2", copy=False))
    grey = picture if picture.dtype == np.uint8 else (picture >> 8).astype(np.uint8)
    if pixel_format is PixelFormat.GREY:
        return _flat(grey)
    if pixel_format is PixelFormat.YUYV:
        frame = np.full((*grey.shape, 2), 128, np.uint8)  # chroma 128: no colour
        frame[..., 0] = grey
        return _flat(frame)
    ok, jpeg = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not ok:
        raise ValueError(f"OpenCV made no JPEG of a picture of {grey.shape}")
    return bytes(jpeg)


def _flat(array: npt.NDArray[np.generic]) -> memoryview:
    return np.ascontiguousarray(array).data.cast("B")
