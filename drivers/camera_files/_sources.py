"""Sources of pictures: a folder, or a video. Blocking; no clock, no camera.

Grey pictures are taken as they are stored, turned by no orientation tag. Of colours the luma is
taken, as OpenCV weighs them.
"""

import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.pictures import BrokenPictureError
from drivers.pictures import decode as decode_picture
from messages import say

from ._errors import NoPictureError

Image = NDArray[np.uint8] | NDArray[np.uint16]

ENDINGS: Final = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")
MAX_FILE_BYTES: Final = 128 << 20  # largest file: a picture of 64 million pixels with 16 bits each
_NUMBER: Final = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True)
class Size:
    """The required size of every picture.

    Attributes
    ----------
    width, height : [px]
    allows_8_bits, allows_16_bits : grey levels of a pixel
    """

    width: int
    height: int
    allows_8_bits: bool = True
    allows_16_bits: bool = False

    def take(self, image: NDArray[Any], where: str) -> Image:
        """Return a picture in grey (height, width), read-only.

        Parameters
        ----------
        image : as OpenCV read it
        where : the picture, for messages

        Raises
        ------
        NoPictureError : another size, or another pixel format
        """
        height, width = image.shape[:2]
        if (width, height) != (self.width, self.height):
            raise NoPictureError(
                say(
                    "{where}: {width} x {height} px; `size_px` of this camera is "
                    "{expected_width} x {expected_height}",
                    where=where,
                    width=width,
                    height=height,
                    expected_width=self.width,
                    expected_height=self.height,
                )
            )
        depth = image.shape[2] if image.ndim == 3 else 1
        if (depth, str(image.dtype)) not in ((1, "uint8"), (1, "uint16"), (3, "uint8")):
            raise NoPictureError(
                say(
                    "{where}: {depth} x {dtype} a pixel; grey with 8 or 16 bits is "
                    "expected, or colour with 8",
                    where=where,
                    depth=depth,
                    dtype=image.dtype,
                )
            )
        is_deep = image.dtype == np.uint16
        if not (self.allows_16_bits if is_deep else self.allows_8_bits):
            raise NoPictureError(
                say(
                    "{where}: {bits} bits a pixel, which `formats` of this camera does "
                    "not allow; add {format} there",
                    where=where,
                    bits=16 if is_deep else 8,
                    format="Y16" if is_deep else "GREY",
                )
            )
        found = image if depth == 1 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        grey: Image = np.ascontiguousarray(found, image.dtype)
        grey.flags.writeable = False
        return grey


class Source(Protocol):
    """Pictures in an order, each found by its number."""

    def __init__(self, name: str, path: Path, size: Size) -> None:
        """Name the pictures; opens nothing.

        Parameters
        ----------
        name : name of the camera, for messages
        path : path of the folder or the file
        size : size required of every picture
        """

    @property
    def words(self) -> str:
        """A description of the open source; for people."""
        ...

    @property
    def count(self) -> int:
        """The number of pictures; known once `read` has returned None."""
        ...

    def open(self) -> Image:
        """Check the source, and return the first picture.

        Raises
        ------
        NoPictureError : nothing there, or it is not what it should be
        """
        ...

    def read(self, number: int) -> Image | None:
        """Return the picture of a number, from 0; None behind the last one.

        Raises
        ------
        NoPictureError : it is gone, or is not what it was
        """
        ...

    def close(self) -> None:
        """Release the files."""
        ...


class Folder:
    """The pictures of a folder by their names, numbers in names by their value.

    Parameters
    ----------
    name : name of the camera, for messages
    path : path of the folder
    size : size required of every picture
    """

    def __init__(self, name: str, path: Path, size: Size) -> None:
        self._name = name
        self._path = path
        self._size = size
        self._files: tuple[Path, ...] = ()

    @property
    def words(self) -> str:
        """A description, for people."""
        return say("folder {name} with {count} pictures", name=self._path.name, count=self.count)

    @property
    def count(self) -> int:
        """The number of pictures."""
        return len(self._files)

    def open(self) -> Image:
        """Read every picture once, so that no fault is found half-way; return the first.

        Raises
        ------
        NoPictureError : no folder, no picture in it, or one that is not what it should be
        """
        try:
            found = [
                path
                for path in self._path.iterdir()
                if path.suffix.lower() in ENDINGS and not path.name.startswith(".")
            ]
        except OSError as error:
            raise NoPictureError(
                say(
                    "{name}: {path}: {strerror}; a folder of pictures is expected",
                    name=self._name,
                    path=self._path,
                    strerror=error.strerror,
                )
            ) from error
        if not found:
            raise NoPictureError(
                say(
                    "{name}: {path}: no picture ({endings}) is in this folder",
                    name=self._name,
                    path=self._path,
                    endings=", ".join(ENDINGS),
                )
            )
        self._files = tuple(sorted(found, key=_by_value))
        first = self._load(self._files[0])
        for path in self._files[1:]:
            image = self._load(path)
            if image.dtype != first.dtype:
                raise NoPictureError(
                    say(
                        "{name}: {path}: {bits} bits a pixel, and {first_bits} in "
                        "{first}; one camera has one format",
                        name=self._name,
                        path=path,
                        bits=8 * image.itemsize,
                        first_bits=8 * first.itemsize,
                        first=self._files[0].name,
                    )
                )
        return first

    def read(self, number: int) -> Image | None:
        """Return the picture of a number; None behind the last one."""
        return self._load(self._files[number]) if number < len(self._files) else None

    def close(self) -> None:
        """Do nothing: no file is kept open."""

    def _load(self, path: Path) -> Image:
        where = say("{name}: {path}", name=self._name, path=path)
        try:
            status = path.stat()
            if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_FILE_BYTES:
                raise NoPictureError(
                    say(
                        "{where}: is no plain file of at most {max_mib} MiB",
                        where=where,
                        max_mib=MAX_FILE_BYTES >> 20,
                    )
                )
            data = path.read_bytes()
        except OSError as error:
            raise NoPictureError(
                say("{where}: {strerror}", where=where, strerror=error.strerror)
            ) from error
        try:
            image = decode_picture(data, "colour")
        except BrokenPictureError as error:
            raise NoPictureError(say("{where}: {error}", where=where, error=error)) from error
        return self._size.take(image, where)


def _by_value(path: Path) -> list[tuple[int, str]]:
    """Return the sort key that puts ``9.png`` before ``10.png``."""
    parts = _NUMBER.split(path.name)
    return [(int(part), part) if part.isdigit() else (0, part) for part in parts]


class Video:
    """The pictures of a video, one after another.

    Parameters
    ----------
    name : name of the camera, for messages
    path : path of the file
    size : size required of every picture
    """

    def __init__(self, name: str, path: Path, size: Size) -> None:
        self._name = name
        self._path = path
        self._size = size
        self._film: cv2.VideoCapture | None = None
        self._next = 0  # the number of the picture that is read next

    @property
    def words(self) -> str:
        """A description, for people."""
        return say("video {name}", name=self._path.name)

    @property
    def count(self) -> int:
        """The number of pictures found so far: all, once `read` has returned None."""
        return self._next

    def open(self) -> Image:
        """Open the file and return its first picture; the others have the same size.

        Raises
        ------
        NoPictureError : no video that can be read, or not of this camera's size
        """
        first = self.read(0)
        if first is None:
            raise NoPictureError(
                say("{name}: {path}: no picture is in this video", name=self._name, path=self._path)
            )
        return first

    def read(self, number: int) -> Image | None:
        """Return the picture of a number; None behind the last one."""
        film = self._film
        if film is None or number < self._next:
            film = self._begin()
        while self._next < number:
            if not film.grab():
                return None
            self._next += 1
        is_there, image = film.read()
        if not is_there:
            return None
        self._next += 1
        return self._size.take(
            image,
            say(
                "{name}: {path}, picture {number}", name=self._name, path=self._path, number=number
            ),
        )

    def close(self) -> None:
        """Close the file."""
        if self._film is not None:
            self._film.release()
            self._film = None

    def _begin(self) -> cv2.VideoCapture:
        self.close()
        where = f"{self._name}: {self._path}"
        # OpenCV takes an address for a network camera, and a pattern for a list of files
        if not self._path.is_file() or "%" in self._path.name:
            raise NoPictureError(say("{where}: no such video file", where=where))
        try:
            film = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        except cv2.error:
            film = None
        if film is None or not film.isOpened():
            raise NoPictureError(say("{where}: is no video that OpenCV can read", where=where))
        film.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        self._film, self._next = film, 0
        return film
