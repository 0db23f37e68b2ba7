"""What a triangle file promises, looked at before it is read whole: its size, header and text.

So that a header of four bytes or a text cut short costs neither time nor memory.
"""

import io
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ..errors import EmptyCadError, LargeCadError, UnreadableCadError
from ..solid import check_count

STL_HEADER_BYTES: Final = 84  # 80 of text, then the count of triangles
STL_TRIANGLE_BYTES: Final = 50
MAX_BYTES: Final = 700_000_000  # two million triangles of text STL, generously written
CHUNK_BYTES: Final = 1 << 20
HEADER_BYTES: Final = 1 << 16


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


def no_file(path: Path, error: Exception) -> UnreadableCadError:
    """Return what to say of a file the system does not give us."""
    reason = error.strerror if isinstance(error, OSError) else None
    return UnreadableCadError(f"{path}: {reason or error}; check the path")


def read_file(path: Path) -> bytes:
    """Return a file's bytes; raise UnreadableCadError where the system does not give them."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise no_file(path, error) from error


def check_ahead(path: Path, ending: str, size: int) -> None:
    """Refuse from its size, its header and a look through it what is not worth reading.

    Parameters
    ----------
    path : a regular file, as `size_of` finds
    ending : of its name, in lower case with the dot
    size : of the file [bytes]

    Raises
    ------
    EmptyCadError : nothing in it, or only blanks
    LargeCadError : more bytes, or more triangles announced, than a part is worth
    UnreadableCadError : the system does not give the file, or it is cut short
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
            if size == 0 or not (head.strip() or size > len(head)):
                raise EmptyCadError(f"{path}: the file is empty; export the part again")
            if ending == ".stl" and _is_binary_stl(head, size, path):
                return
            if size > MAX_BYTES:
                raise LargeCadError(
                    f"{path}: {size / 1e6:,.0f} MB, the most is {MAX_BYTES / 1e6:,.0f} MB; "
                    "export it with a coarser chord error"
                )
            if ending in AHEAD:
                file.seek(0)
                AHEAD[ending](file, path, size)
    except OSError as error:
        raise no_file(path, error) from error


def _is_binary_stl(head: bytes, size: int, path: Path) -> bool:
    """Return whether an STL is binary; raise where it is cut short, or neither binary nor text."""
    promised = int.from_bytes(head[80:STL_HEADER_BYTES], "little")
    if size == STL_HEADER_BYTES + STL_TRIANGLE_BYTES * promised:
        check_count(promised, str(path))
        return True  # looked at first, since binary files too may begin with "solid"
    if head.lstrip()[:5].lower() == b"solid":
        return False
    if b"\0" not in head or size < STL_HEADER_BYTES:
        raise UnreadableCadError(f"{path}: is not STL, despite its name; export it again")
    held = (size - STL_HEADER_BYTES) / STL_TRIANGLE_BYTES
    raise UnreadableCadError(
        f"{path}: promises {promised} triangles and holds {held:.1f}; copy or export it again"
    )


def _look_through(file: io.BufferedReader, path: Path, word: bytes) -> tuple[int, bytes]:
    """Return how often a text holds a word, and its end; raise where it is no text."""
    count, tail, read = 0, b"", 0
    while chunk := file.read(CHUNK_BYTES):
        if (at := chunk.find(b"\0")) >= 0:
            raise UnreadableCadError(
                f"{path}: byte {read + at} is not text; is it the right file? export it again"
            )
        text = tail[-len(word) + 1 :] + chunk.lower()
        count += text.count(word)
        tail, read = text[-HEADER_BYTES:], read + len(chunk)
        check_count(count, str(path))
    return count, tail


def _look_at_stl(file: io.BufferedReader, path: Path, size: int) -> None:
    _, tail = _look_through(file, path, b"endfacet")
    _check_text(path)
    if b"endsolid" not in tail:
        raise UnreadableCadError(f"{path}: the text breaks off; copy or export it again")


def _look_at_obj(file: io.BufferedReader, path: Path, size: int) -> None:
    _look_through(file, path, b"\nf ")
    _check_text(path)


def _look_at_off(file: io.BufferedReader, path: Path, size: int) -> None:
    _check_text(path)
    words = [
        w for line in file.read(HEADER_BYTES).splitlines() for w in line.split(b"#")[0].split()
    ]
    counts = [int(w) for w in words[1:3] if w.isdigit()]
    _check_promises(dict(zip(("corners", "triangles"), counts, strict=False)), size, path)


def _look_at_ply(file: io.BufferedReader, path: Path, size: int) -> None:
    promised: dict[str, int] = {}
    for line in file.read(HEADER_BYTES).split(b"end_header")[0].splitlines():
        words = line.split()
        if len(words) == 3 and words[0] == b"element" and words[2].isdigit():
            kind = {b"vertex": "corners", b"face": "triangles"}.get(words[1], "other elements")
            promised[kind] = int(words[2])
    _check_promises(promised, size, path)


def _check_promises(promised: Mapping[str, int], size: int, path: Path) -> None:
    """Raise where a header promises more than the file has bytes for, or more than is read."""
    for kind, count in promised.items():
        if 3 * count > size:  # three coordinates or corners at a byte each, and no reader reserves
            raise UnreadableCadError(
                f"{path}: promises {count:,} {kind} and is {size:,} bytes long; "
                "copy or export it again"
            )
    check_count(promised.get("triangles", 0), str(path))


def _check_text(path: Path) -> None:
    data = read_file(path)
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UnreadableCadError(
            f"{path}: byte {error.start} is not text (UTF-8); is it the right file? export it again"
        ) from error


AHEAD: Final[Mapping[str, Callable[[io.BufferedReader, Path, int], None]]] = MappingProxyType(
    {".stl": _look_at_stl, ".obj": _look_at_obj, ".off": _look_at_off, ".ply": _look_at_ply}
)
