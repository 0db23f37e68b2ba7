"""Stored pictures for recognition: grey, 8 bits, of the calibration's size; or the reason.

Pixels are read as stored. Orientation tags, which a viewer would follow, are ignored: the
calibration holds for the sensor's pixels.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.arrays import Grey
from controller.config import ConfigError
from controller.config.files import read_bytes
from drivers.pictures import MAX_PIXELS as MAX_PIXELS
from drivers.pictures import BrokenPictureError, Pixels, size_in_header
from drivers.pictures import decode as decode_picture

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp")
CAMERA_BITS = (8, 10, 12, 14, 16)  # bit depths of sensors
UNIT_RANGE = 2.0  # decimals up to this are 0..1: as levels of 0..255 they would all be black
NOISE_BELOW_ZERO = 0.02  # share of the brightest level: filters leave a little below black
MAX_PICTURE_BYTES = 128 * 2**20


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
    size_px : (width, height) size of the calibration

    Raises
    ------
    ConfigError : it is missing, cannot be read, or has not the camera's size
    """
    stored = _stored(path, size_px)
    notes: list[str] = []
    levels = _single(stored, notes)
    return StoredPicture(_eight_bits(path, levels, notes), tuple(notes))


def read_grey(path: Path, size_px: tuple[int, int]) -> Grey:
    """Return a camera's picture for measuring: grey, 8 bits, no level changed.

    Three equal channels are one. Colours are refused, as those of a colour sensor are guessed
    between its pixels; so are more bits, as each picture would be scaled by its own brightest.

    Parameters
    ----------
    path : the picture's file
    size_px : (width, height) size of the calibration

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
    size = size_in_header(data)  # before anything is decoded
    if size is not None and min(size) and size != size_px:
        raise ConfigError(
            f"{path}: {size[0]} x {size[1]} px, the calibration is for "
            f"{size_px[0]} x {size_px[1]} px"
        )
    return decoded(path, data, "stored")


def read_whole(path: Path) -> bytes:
    """Return the bytes of a picture file.

    Raises
    ------
    ConfigError : the file is missing, too large or empty
    """
    data = read_bytes(path, MAX_PICTURE_BYTES, "a picture")
    if not data:
        raise ConfigError(f"{path}: the file is empty")
    return data


def decoded(path: Path, data: bytes, pixels: Pixels) -> NDArray[Any]:
    """Return a picture's pixels.

    Parameters
    ----------
    path : the file, for the message
    data : all its bytes
    pixels : layout of the channels

    Raises
    ------
    ConfigError : it is no picture, is larger than any camera's, is cut off or damaged
    """
    try:
        return decode_picture(data, pixels)
    except BrokenPictureError as error:
        raise ConfigError(f"{path}: {error}") from error


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
    """Return the brightest possible level, and its origin in words.

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
    """Return the number of lowest bits that are 0 in every level."""
    used = int(np.bitwise_or.reduce(levels, axis=None))
    return (used & -used).bit_length() - 1 if used else 0


def _scaled(levels: NDArray[Any], full: float) -> Grey:
    return np.clip(np.round(levels.astype(np.float64) * (255.0 / full)), 0, 255).astype(np.uint8)


class SaidOnce:
    """A filter that passes each kind of remark once per run, for the first such picture."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def fresh(self, notes: Sequence[str]) -> list[str]:
        """Return the notes of a kind not seen before."""
        # the brackets hold what differs from picture to picture
        kinds = {note.split(" (")[0]: note for note in notes}
        new = [note for kind, note in kinds.items() if kind not in self._told]
        self._told.update(kinds)
        return new
