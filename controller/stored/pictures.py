"""Stored pictures as recognition needs them: grey, 8 bits, of the calibration's size; or why not.

Pixels are read as stored. Orientation tags, which a viewer would follow, are ignored: the
calibration holds for the sensor's pixels.
"""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import Grey
from controller.config import ConfigError
from controller.config.files import read_bytes

from ._picture_header import JPEG_BEGIN, PNG_BEGIN, size_in_header

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp")
CAMERA_BITS = (8, 10, 12, 14, 16)  # what sensors deliver
UNIT_RANGE = 2.0  # decimals up to here are 0..1: as levels of 0..255 they would all be black
NOISE_BELOW_ZERO = 0.02  # of the brightest level: filters leave a little below black
MAX_PIXELS = 64_000_000  # the largest machine-vision sensors have a little over half of it
MAX_PICTURE_BYTES = 128 * 2**20
JPEG_END = b"\xff\xd9"


@dataclass(frozen=True, eq=False, slots=True)
class StoredPicture:
    """A picture from a file.

    Attributes
    ----------
    grey : (height, width)
    notes : in words, what was done to make it grey with 8 bits
    """

    grey: Grey
    notes: tuple[str, ...]


def pictures_among(paths: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """Return the pictures that a command line names, those of a folder sorted, and remarks.

    A picture named twice counts once.

    Raises
    ------
    ConfigError : a folder has no pictures or cannot be read
    """
    found: list[Path] = []
    for path in paths:
        found += _pictures_in(path) if path.is_dir() else [path]
    kept: dict[Path, Path] = {}
    remarks = []
    for path in found:
        if kept.setdefault(path.resolve(), path) is not path:
            remarks.append(f"{path}: named twice, answered once")
    return list(kept.values()), remarks


def _pictures_in(folder: Path) -> list[Path]:
    try:
        files = sorted(folder.iterdir())
    except OSError as error:
        raise ConfigError(f"{folder}: {error.strerror}; check the path") from error
    found = [f for f in files if f.suffix.lower() in ENDINGS and not f.name.startswith(".")]
    if not found:
        raise ConfigError(f"{folder}: no picture in this folder ({', '.join(ENDINGS)})")
    return found


def read_picture(path: Path, size_px: tuple[int, int]) -> StoredPicture:
    """Return a camera's picture, read from a file.

    Parameters
    ----------
    path : the picture's file
    size_px : (width, height) of the calibration

    Raises
    ------
    ConfigError : it is missing, cannot be read, or has not the camera's size
    """
    stored = _stored(path, size_px)
    notes: list[str] = []
    levels = _single(stored, notes)
    return StoredPicture(_eight_bits(path, levels, notes), tuple(notes))


def read_grey(path: Path, size_px: tuple[int, int]) -> Grey:
    """Return a camera's picture as it is measured in: grey, 8 bits, no level changed.

    Three equal channels are one. Colours are refused, as those of a colour sensor are guessed
    between its pixels; so are more bits, as each picture would be scaled by its own brightest.

    Parameters
    ----------
    path : the picture's file
    size_px : (width, height) of the calibration

    Raises
    ------
    ConfigError : it is missing, cannot be read, has not the camera's size, or is not grey of 8 bits
    """
    stored = _stored(path, size_px)
    if stored.dtype != np.uint8:
        raise ConfigError(
            f"{path}: {8 * stored.dtype.itemsize} bits a pixel; grey of 8 bits is expected: "
            "convert all pictures of the set alike"
        )
    notes: list[str] = []
    levels = _single(stored, notes)
    if notes:
        raise ConfigError(
            f"{path}: has colour or transparency; grey of 8 bits is expected: what a colour camera "
            "fills in between its pixels moves edges"
        )
    return np.ascontiguousarray(levels, dtype=np.uint8)


def _stored(path: Path, size_px: tuple[int, int]) -> NDArray[Any]:
    """Return a picture's pixels as stored, of the camera's size."""
    data = read_whole(path)
    width, height = size_of(path, data)
    if (width, height) != size_px:
        raise ConfigError(
            f"{path}: {width} x {height} px, the calibration is for {size_px[0]} x {size_px[1]} px"
        )
    return decoded(path, data, cv2.IMREAD_UNCHANGED)


def read_whole(path: Path) -> bytes:
    """Return the bytes of a complete picture file.

    Raises
    ------
    ConfigError : the file is missing, too large, empty or cut off
    """
    data = read_bytes(path, MAX_PICTURE_BYTES, "a picture")
    if not data:
        raise ConfigError(f"{path}: the file is empty")
    if not _is_whole(data):
        raise ConfigError(f"{path}: the picture is cut off or damaged; copy it again")
    return data


def size_of(path: Path, data: bytes) -> tuple[int, int]:
    """Return (width, height) of a picture by its header, before anything is decoded.

    Raises
    ------
    ConfigError : it is no picture, has no pixels, or is larger than any camera's
    """
    size = size_in_header(data)
    if size is None:
        raise ConfigError(f"{path}: is not a readable picture (PNG, JPEG, TIFF)")
    width, height = size
    if not width or not height:
        raise ConfigError(f"{path}: is not a readable picture: it has no pixels")
    if width * height > MAX_PIXELS:
        raise ConfigError(
            f"{path}: {width} x {height} px; a camera's picture has at most "
            f"{MAX_PIXELS / 1e6:.0f} million"
        )
    return size


def decoded(path: Path, data: bytes, flags: int) -> NDArray[Any]:
    """Return a picture's pixels as OpenCV reads them.

    Parameters
    ----------
    path : the file, for the message
    data : all its bytes
    flags : of `cv2.imdecode`: colours and depth

    Raises
    ------
    ConfigError : OpenCV cannot decode it
    """
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    # of a bad file, decoders print complaints of their own; the message below is enough
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        stored = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:  # no picture, or one larger than OpenCV reads
        stored = None
    finally:
        logging.setLogLevel(level)
    if stored is None or stored.size == 0:
        raise ConfigError(f"{path}: is not a readable picture (PNG, JPEG, TIFF)")
    return np.asarray(stored)


def _is_whole(data: bytes) -> bool:
    """Return whether a PNG or JPEG file is complete; decoders would fill in what is missing."""
    if data.startswith(PNG_BEGIN):
        return _is_whole_png(data)
    if data.startswith(JPEG_BEGIN):
        return JPEG_END in data[-1024:]  # some programs append a few bytes
    return True


def _is_whole_png(data: bytes) -> bool:
    """Return whether all chunks of a PNG file are there, with correct checksums."""
    at = len(PNG_BEGIN)
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        name, end = data[at + 4 : at + 8], at + 8 + length
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return False
        if name == b"IEND":
            return True
        at = end + 4
    return False


def _single(stored: NDArray[Any], notes: list[str]) -> NDArray[Any]:
    """Return one channel of a stored picture."""
    if stored.ndim == 2:
        return stored
    if stored.shape[2] in (2, 4):
        opaque = stored[..., -1]
        if (opaque != opaque.max()).any():
            notes.append("transparency is ignored")
        stored = stored[..., :-1]
    first = stored[..., 0]
    if stored.shape[2] == 1 or all(
        np.array_equal(first, stored[..., k], equal_nan=stored.dtype.kind == "f")
        for k in range(1, stored.shape[2])
    ):
        return first
    notes.append("colour is turned to grey")
    # weights of perceived brightness (ITU-R BT.601), in OpenCV's order: blue, green, red
    weights = np.array([0.114, 0.587, 0.299])
    grey = stored[..., :3].astype(np.float64) @ weights
    return np.asarray(grey if stored.dtype.kind == "f" else np.round(grey).astype(stored.dtype))


def _eight_bits(path: Path, levels: NDArray[Any], notes: list[str]) -> Grey:
    if levels.dtype == np.uint8:
        return np.ascontiguousarray(levels, dtype=np.uint8)
    if levels.dtype.kind == "f" and not np.isfinite(levels).all():
        raise ConfigError(f"{path}: some of its grey levels are not numbers")
    low, high = float(levels.min()), float(levels.max())
    if low < -NOISE_BELOW_ZERO * max(high, 0.0):
        raise ConfigError(f"{path}: grey levels below zero, down to {low:g}: is it a picture?")
    if levels.dtype.kind == "f" and high <= UNIT_RANGE:
        notes.append("levels with decimals are taken as 0 to 1")
        return _scaled(levels, 1.0)
    if high >= 2**16:
        raise ConfigError(
            f"{path}: grey levels up to {high:g}; at most 16 bits are allowed, or decimals up to 1"
        )
    full, range_text = _range_of(levels, int(high))
    notes.append(f"levels {range_text}")
    return _scaled(levels, full)


def _range_of(levels: NDArray[Any], high: int) -> tuple[float, str]:
    """Return the brightest possible level, and in words where it comes from.

    Pictures of 10, 12 or 14 bits are stored in 16: at the lower end, so that no level exceeds their
    range, or at the upper end, with the lowest bits empty. A picture too dark to fill its range is
    brightened by a power of two, which does not affect recognition.
    """
    if levels.dtype.kind in "iu":
        empty = _empty_bits(levels)
        if 16 - empty in CAMERA_BITS[1:4] and high.bit_length() > 16 - empty:
            return float(2**16 - 2**empty), f"of {16 - empty} bits, stored at the upper end of 16"
    bits = next(bits for bits in CAMERA_BITS if high < 2**bits)
    return float(2**bits - 1), f"are taken as those of {bits} bits (the brightest is {high})"


def _empty_bits(levels: NDArray[Any]) -> int:
    """Return how many of the lowest bits are 0 in every level."""
    used = int(np.bitwise_or.reduce(levels, axis=None))
    return (used & -used).bit_length() - 1 if used else 0


def _scaled(levels: NDArray[Any], full: float) -> Grey:
    return np.clip(np.round(levels.astype(np.float64) * (255.0 / full)), 0, 255).astype(np.uint8)


class SaidOnce:
    """Passes each kind of remark once per run: for the first picture that has it."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def fresh(self, notes: Sequence[str]) -> list[str]:
        """Return the notes of a kind not seen before."""
        # the brackets hold what differs from picture to picture
        kinds = {note.split(" (")[0]: note for note in notes}
        new = [note for kind, note in kinds.items() if kind not in self._told]
        self._told.update(kinds)
        return new
