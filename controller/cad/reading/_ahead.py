"""Checks of a CAD file's size and first bytes before it is read whole.

A false count in a header of four bytes then costs neither time nor memory.
"""

import stat
from pathlib import Path
from typing import Final

from controller.config.files import encoding_of

from ..errors import EmptyCadError, LargeCadError, UnreadableCadError
from ..solid import check_count
from .meshes.stl import HEADER_BYTES, TRIANGLE_BYTES, is_binary, promised

MAX_BYTES: Final = 700_000_000  # two million triangles of text STL, generously written
HEAD_BYTES: Final = 1 << 16


def size_of(path: Path) -> int:
    """Return a regular file's size [bytes].

    Raises
    ------
    UnreadableCadError : no such file, or a directory, a pipe, a device
    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise no_file(path, error) from error
    if stat.S_ISDIR(found.st_mode):
        raise UnreadableCadError(f"{path}: is a directory; name the file in it")
    if not stat.S_ISREG(found.st_mode):
        raise UnreadableCadError(
            f"{path}: is not a regular file; copy it to one"
        )  # a pipe would hang
    return found.st_size


def is_binary_stl(path: Path) -> bool:
    """Return True for a complete binary STL file, judged by name, header and size."""
    if path.suffix.lower() != ".stl":
        return False
    try:
        with path.open("rb") as file:
            return is_binary(file.read(HEADER_BYTES), size_of(path))
    except OSError as error:
        raise no_file(path, error) from error


def no_file(path: Path, error: Exception) -> UnreadableCadError:
    """Return the error for a file that the system cannot read."""
    reason = error.strerror if isinstance(error, OSError) else None
    return UnreadableCadError(f"{path}: {reason or error}; check the path")


def read_file(path: Path) -> bytes:
    """Return a file's bytes; raise UnreadableCadError where the system cannot read it."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise no_file(path, error) from error


def check_ahead(path: Path, ending: str, size: int) -> None:
    """Refuse a file by its size and first bytes, before it is read whole.

    Parameters
    ----------
    path : a regular file, as `size_of` finds
    ending : ending of its name, in lower case with the dot
    size : size of the file [bytes]

    Raises
    ------
    EmptyCadError : nothing in it, or only blanks
    LargeCadError : more bytes, or more triangles announced, than a part is worth
    UnreadableCadError : the system does not give the file, or it is cut short
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
            if size == 0 or not (head.strip() or size > len(head)):
                raise EmptyCadError(f"{path}: the file is empty; export the part again")
            if ending == ".stl":
                _check_stl(head, size, path)
            if size > MAX_BYTES:
                raise LargeCadError(
                    f"{path}: {size / 1e6:,.0f} MB, the most is {MAX_BYTES / 1e6:,.0f} MB; "
                    "export it with a coarser chord error"
                )
    except OSError as error:
        raise no_file(path, error) from error


def _check_stl(head: bytes, size: int, path: Path) -> None:
    """Refuse an STL that is truncated, neither binary nor text, or has too many triangles."""
    if is_binary(head, size):
        check_count(promised(head), str(path))
        return
    if b"\0" not in head or encoding_of(head) != "utf-8-sig":
        if b"solid" not in head.replace(b"\0", b"").lower():
            raise UnreadableCadError(f"{path}: is not STL, despite its name; export it again")
        return
    held = (size - HEADER_BYTES) / TRIANGLE_BYTES
    if held < 0:
        raise UnreadableCadError(f"{path}: is not STL, despite its name; export it again")
    raise UnreadableCadError(
        f"{path}: promises {promised(head)} triangles and holds {held:.1f}; copy or export it again"
    )
