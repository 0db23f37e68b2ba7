"""Files: read plain ones of limited size only, never a pipe; written whole or not at all.

A name written by somebody else leads to no file outside its folder.
"""

import codecs
import hashlib
import json
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from controller.yaml_text import LARGEST_NUMBER, NO_NUMBER

from .errors import ConfigError

MAX_TEXT_BYTES = 128 * 1024  # ten times a usual recipe or cell file
CHUNK_BYTES = 1 << 20
FIRST_BYTES = 32  # bytes that identify UTF-16 without a mark
# UTF-32's mark begins as UTF-16's does
MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def read_bytes(path: Path, max_bytes: int, what: str) -> bytes:
    """Return the bytes of a plain file; no more than the limit is ever read.

    Parameters
    ----------
    path : the file
    max_bytes : a larger file is refused
    what : the kind of file, for the message

    Raises
    ------
    ConfigError : no such file, a directory, a pipe, a device, too large, or not readable
    """
    try:
        # without O_NONBLOCK, opening a pipe would wait until somebody writes to it
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: {reason_of(error)}; check the path") from error
    try:
        status = os.fstat(handle)
        if stat.S_ISDIR(status.st_mode):
            raise ConfigError(f"{path}: is a directory; name the file in it")
        if not stat.S_ISREG(status.st_mode):
            raise ConfigError(f"{path}: is not a plain file; copy it to one")
        data = bytearray()
        # read to the end, whatever size is reported: files in /proc report no bytes
        is_too_large = status.st_size > max_bytes
        while (
            not is_too_large and len(data) <= max_bytes and (chunk := os.read(handle, CHUNK_BYTES))
        ):
            data += chunk
    except OSError as error:
        raise ConfigError(f"{path}: {reason_of(error)}; check the file") from error
    finally:
        os.close(handle)
    if is_too_large or len(data) > max_bytes:
        raise ConfigError(
            f"{path}: has more than {max_bytes / 1024:,.0f} KiB; {what} is smaller. Is it the "
            "right file?"
        )
    return bytes(data)


def read_sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal, however large it is.

    Raises
    ------
    OSError : it cannot be read
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file that a person has named, in hexadecimal.

    Raises
    ------
    ConfigError : it cannot be read
    """
    try:
        return read_sha256(path)
    except OSError as error:
        raise ConfigError(f"{path}: {reason_of(error)}") from error


def read_text(
    path: Path, what: str, max_bytes: int = MAX_TEXT_BYTES, *, is_lenient: bool = False
) -> str:
    """Return the text of a plain file.

    Parameters
    ----------
    path : the file
    what : the kind of file, for the message
    max_bytes : a larger file is refused
    is_lenient : put U+FFFD in place of what is not UTF-8; the caller refuses it where it
        matters, which in a comment it does not

    Raises
    ------
    ConfigError : as in `read_bytes`, or not UTF-8
    """
    return text_of(read_bytes(path, max_bytes, what), path, is_lenient=is_lenient)


def text_of(data: bytes, path: Path, *, is_lenient: bool = False) -> str:
    """Return the text of a file in UTF-8, UTF-16 or UTF-32, by its first bytes.

    Parameters
    ----------
    data : data of the file
    path : path of the file, for the message
    is_lenient : as in `read_text`

    Raises
    ------
    ConfigError : in another encoding; the message names the line, and has it in code page 1252
    """
    encoding = encoding_of(data)
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        if b"\0" in data:
            raise ConfigError(f"{path}: is not a text file; is it the right file?") from error
        if is_lenient:
            return data.decode(encoding, errors="replace")
        line = data.count(b"\n", 0, error.start) + 1
        begin = data.rfind(b"\n", 0, error.start) + 1
        shown = data[begin : error.start + 40].partition(b"\n")[0].decode("cp1252", "replace")
        raise ConfigError(
            f"{path}: line {line} ({shown.strip():.60}) is not text in UTF-8; save the file as "
            "UTF-8"
        ) from error


def parse_json(text: str | bytes, path: Path, what: str) -> Any:  # noqa: ANN401 - any JSON
    """Return the value of a JSON text.

    Parameters
    ----------
    text : text of the file
    path : path of the file, for the message
    what : expected content, for the message

    Raises
    ------
    ConfigError : no JSON, a key that stands twice, or a number that is none or beyond
        `LARGEST_NUMBER`, with its key
    """
    if isinstance(text, bytes):
        text = text_of(text, path)
    try:
        tree = json.loads(text, object_pairs_hook=_once_each)
    except json.JSONDecodeError as error:
        raise ConfigError(
            f"{path}:{error.lineno}: not valid JSON: {error.msg}; {what} is expected"
        ) from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid JSON: {error!s:.120}; {what} is expected") from error
    for key, number in _numbers(tree, ""):
        if not is_sensible(number):
            raise ConfigError(f"{path}: `{key}`: {number!s:.40} {NO_NUMBER}")
    return tree


def is_sensible(number: float) -> bool:
    """Return whether a number from a file is usable: finite, up to `LARGEST_NUMBER`."""
    return abs(number) <= LARGEST_NUMBER


def _numbers(tree: object, key: str) -> Iterator[tuple[str, float]]:
    if isinstance(tree, int | float) and not isinstance(tree, bool):
        yield key, tree
    elif isinstance(tree, dict):
        for name, value in tree.items():
            yield from _numbers(value, f"{key}.{name}".lstrip("."))
    elif isinstance(tree, list):
        for number, value in enumerate(tree):
            yield from _numbers(value, f"{key}[{number}]")


def _once_each(pairs: Sequence[tuple[str, Any]]) -> Mapping[str, Any]:
    """Return the pairs of an object; raise ValueError if a key occurs twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice!r:.60} stands twice in one object")
    return found


def utf8_of(data: bytes) -> bytes:
    """Return a text without its byte order mark, in UTF-8 if the mark was of UTF-16 or UTF-32.

    Parameters
    ----------
    data : data of the file; in a code page that agrees with ASCII it stays as it is
    """
    encoding = encoding_of(data)
    if encoding != "utf-8-sig":
        data = data.decode(encoding, errors="replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def encoding_of(data: bytes) -> str:
    """Return the encoding of a text by its byte order mark, UTF-8 without one.

    UTF-16 without a mark is known by the zero byte in each letter of the first words.

    Parameters
    ----------
    data : data of the file, its beginning at least
    """
    for mark, encoding in MARKS:
        if data.startswith(mark):
            return encoding
    for encoding, empty, letters in (
        ("utf-16-le", data[1:FIRST_BYTES:2], data[:FIRST_BYTES:2]),
        ("utf-16-be", data[:FIRST_BYTES:2], data[1:FIRST_BYTES:2]),
    ):
        if len(empty) > 1 and not any(empty) and all(letters):
            return encoding
    return "utf-8-sig"


def file_within(folder: Path, name: str) -> Path | None:
    """Return a file below a folder; None if its name or a link leads outside.

    Parameters
    ----------
    folder : folder that the file must lie in
    name : relative to it, as somebody else has written it
    """
    inside = folder.resolve()
    path = (inside / name).resolve()
    return path if path.is_relative_to(inside) else None


def reason_of(error: Exception) -> str:
    """Return the system's own message about a file."""
    told = error.strerror if isinstance(error, OSError) else None
    return told or str(error)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, whole or not at all.

    Parameters
    ----------
    path : the file; its folder is made if it is not there
    content : all of it

    Raises
    ------
    ConfigError : it cannot be written; what was there before still is
    """
    # a file name in a text may have bytes that are no text
    data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".", delete=False) as draft:
            try:
                draft.write(data)
                draft.flush()
                os.fsync(draft.fileno())
                Path(draft.name).chmod(0o644)
                Path(draft.name).replace(path)
            except OSError:
                Path(draft.name).unlink(missing_ok=True)
                raise
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {reason_of(error)}") from error
