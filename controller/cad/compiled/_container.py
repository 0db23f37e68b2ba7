"""One file that holds arrays and a header, and is whole or not believed.

Layout: 16 bytes of name, 32 bytes SHA-256 over all that follows, 8 bytes length of the header
(little endian), the header (JSON), then the arrays, each at a multiple of 64 bytes so that numpy
reads them in place.
"""

import hashlib
import json
import os
import stat
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._columns import CodecError

NAME = b"cellctl part \r\n\0"
DIGEST_AT = len(NAME)
BODY_AT = DIGEST_AT + hashlib.sha256().digest_size
HEADER_AT = BODY_AT + 8
ALIGNED = 64
MOST_BYTES = 2**30  # of a file; the largest parts come to a tenth of it
MOST_HEADER_BYTES = 2**24  # JSON takes twenty times its length in memory
DTYPES = ("|b1", "|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f2", "<f4", "<f8")


def pack(header: dict[str, Any], arrays: Sequence[NDArray[Any]]) -> bytes:
    """Return a file's bytes; ``header`` is JSON, and may not use the key ``arrays``.

    Raises
    ------
    TypeError : an array of something else than numbers and truths
    """
    index: list[tuple[str, list[int], int]] = []
    offset = 0
    for array in arrays:
        if array.dtype.str not in DTYPES:
            raise TypeError(f"an array of {array.dtype} cannot be stored")
        index.append((array.dtype.str, list(array.shape), offset))
        offset = _aligned(offset + array.nbytes)
    text = json.dumps(header | {"arrays": index}, separators=(",", ":")).encode()
    start = _aligned(HEADER_AT + len(text))
    data = bytearray(start + offset)
    data[:DIGEST_AT] = NAME
    data[BODY_AT:HEADER_AT] = len(text).to_bytes(8, "little")
    data[HEADER_AT : HEADER_AT + len(text)] = text
    for (_, _, at), array in zip(index, arrays, strict=True):
        data[start + at : start + at + array.nbytes] = array.tobytes()
    data[DIGEST_AT:BODY_AT] = hashlib.sha256(memoryview(data)[BODY_AT:]).digest()
    return bytes(data)


def unpack(data: bytearray) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return header and arrays of a file's bytes; the arrays are views of ``data``.

    Raises
    ------
    CodecError : another kind of file, cut short, or changed since it was written
    """
    if len(data) < HEADER_AT or data[:DIGEST_AT] != NAME:
        raise CodecError("is no file of this cache")
    if hashlib.sha256(memoryview(data)[BODY_AT:]).digest() != data[DIGEST_AT:BODY_AT]:
        raise CodecError("is damaged")
    length = int.from_bytes(data[BODY_AT:HEADER_AT], "little")
    if length > min(len(data) - HEADER_AT, MOST_HEADER_BYTES):
        raise CodecError("has a header longer than the file, or than any")
    try:
        header = json.loads(data[HEADER_AT : HEADER_AT + length])
        start = _aligned(HEADER_AT + length)
        arrays = [_view(data, start, *entry) for entry in header.pop("arrays")]
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as e:
        raise CodecError(f"has no proper header ({e})") from e
    return header, arrays


def _view(data: bytearray, start: int, dtype: str, shape: list[int], at: int) -> NDArray[Any]:
    if dtype not in DTYPES or at < 0 or any(length < 0 for length in shape):
        raise ValueError(f"array of {dtype} {shape} at {at}")
    kind = np.dtype(dtype)
    count = 1
    for length in shape:
        count *= length
    if start + at + count * kind.itemsize > len(data):
        raise ValueError(f"array of {dtype} {shape} ends behind the file")
    if count == 0:
        return np.zeros(shape, dtype=kind)
    return np.frombuffer(data, dtype=kind, count=count, offset=start + at).reshape(shape)


def _aligned(offset: int) -> int:
    return -(-offset // ALIGNED) * ALIGNED


def read_file(path: Path) -> bytearray:
    """Return a file's bytes in memory of our own, so that arrays in it are like any others.

    Raises
    ------
    OSError : it cannot be read; CodecError : it is no plain file, or a larger one than any
    """
    # a pipe in its place would keep us for ever
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as file:  # noqa: PTH123  (Path.open takes no descriptor)
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_size > MOST_BYTES:
            raise CodecError("is no plain file, or a larger one than is ever kept")
        data = bytearray(status.st_size)
        filled, view = 0, memoryview(data)
        while filled < len(data):
            got = file.readinto(view[filled:])
            if not got:
                raise CodecError("is cut short while it is read")
            filled += got
    return data


def write_file(path: Path, data: bytes) -> None:
    """Write a file so that others see the old one or the whole new one, never a half.

    Raises
    ------
    OSError : the folder cannot be written
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".part-", suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
