"""The one decoder. JPEG by libjpeg-turbo with its warnings as errors (ADR 18), else OpenCV."""

from typing import Any, Final, Literal

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from messages import key, say

from ._header import JPEG_BEGIN, size_in_header
from ._whole import BrokenPictureError, check_whole

MAX_PIXELS: Final = 64_000_000  # the largest machine-vision sensors have a little over half of it

Pixels = Literal["grey", "colour", "stored"]
"""One channel; one or three; or, as in the file, with transparency and all."""

# The sensor's rows stay rows: an orientation tag is for photo albums, and "unchanged" ignores it.
_FLAGS: Final[dict[Pixels, int]] = {
    "grey": cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION,
    "colour": cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION,
    "stored": cv2.IMREAD_UNCHANGED,
}


def decode(data: bytes, pixels: Pixels) -> NDArray[Any]:
    """Return the picture in the bytes of a file or frame.

    Parameters
    ----------
    data : the whole file: PNG, JPEG, TIFF, BMP, PGM and PPM, or WebP
    pixels : layout of the channels

    Returns
    -------
    (height, width) or (height, width, channels), blue first; of the depth stored

    Raises
    ------
    BrokenPictureError : no such picture, too large a one, cut off, or damaged; the message is a
        clause that says which
    """
    size = size_in_header(data)
    if size is None or not min(size):
        raise BrokenPictureError(key("is not a readable picture (PNG, JPEG, TIFF, BMP, PGM, WebP)"))
    width, height = size
    if width * height > MAX_PIXELS:
        raise BrokenPictureError(
            say(
                "{width} x {height} px; a camera's picture has at most {millions:.0f} million",
                width=width,
                height=height,
                millions=MAX_PIXELS / 1e6,
            )
        )
    if data.startswith(JPEG_BEGIN):
        return _decode_jpeg(data, pixels)
    check_whole(data)
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    # of a bad file, decoders print complaints of their own; the message below is enough
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _FLAGS[pixels])
    except cv2.error:
        image = None
    finally:
        logging.setLogLevel(level)
    if image is None or image.shape[:2] != (height, width):
        raise BrokenPictureError(
            key("is cut off or damaged, or not a readable picture of its format")
        )
    return np.asarray(image)


def _decode_jpeg(data: bytes, pixels: Pixels) -> NDArray[np.uint8]:
    try:
        stored_as = simplejpeg.decode_jpeg_header(data)[2]
        wanted = "GRAY" if pixels == "grey" or stored_as == "Gray" else "BGR"
        image = simplejpeg.decode_jpeg(data, colorspace=wanted, strict=True)
    except (ValueError, KeyError) as error:  # KeyError: a colour space that it does not know
        raise BrokenPictureError(
            say("is cut off or damaged: a JPEG with {error}", error=error)
        ) from error
    return np.asarray(image[..., 0] if wanted == "GRAY" else image, np.uint8)
