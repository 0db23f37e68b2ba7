"""Read and write one file of the cache: a tree in JSON, arrays of numbers, and their hash.

The file is an uncompressed ``.npz`` of numpy's. Its member ``tree`` is UTF-8 JSON. There is one
more member per dtype, which holds all arrays of that dtype end to end, because one member per array
would take a hundred times as long to read. The archive's comment is the SHA-256 [hex] of all bytes
before it.
"""

import hashlib
import io
import json
import os
import stat
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

AnyArray = NDArray[Any]

DIGEST_BYTES = 64  # SHA-256 in hexadecimal
MAX_BYTES = 2**30  # largest file; the largest parts take a tenth of it
MAX_TREE_BYTES = 2**24  # largest text of JSON; in memory, JSON takes twenty times its length
MAX_EMPTY_ROWS = 2**20  # rows without content take no room in a file, but they do in memory
WRITTEN_AT_ONCE = 2**20  # numbers written at a time, so that no second copy of a large part is made
DTYPES = ("b1", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8")


class CacheError(Exception):
    """A damaged, foreign or planted file, or one with another key."""


class TooLargeError(Exception):
    """A value takes so much room that it would not be read again."""


class ArrayWriter:
    """Collects arrays; the tree refers to them by dtype, start and shape."""

    def __init__(self) -> None:
        self._arrays: dict[str, list[AnyArray]] = {}
        self._lengths: dict[str, int] = {}

    def put(self, array: AnyArray) -> list[Any]:
        """Take an array and return the reference to it.

        Raises
        ------
        TypeError : an array of anything but numbers and truth values
        """
        name = array.dtype.str[1:]
        if name not in DTYPES or not array.dtype.isnative:
            raise TypeError(f"an array of {array.dtype} cannot be stored")
        start = self._lengths.get(name, 0)
        self._lengths[name] = start + array.size
        self._arrays.setdefault(name, []).append(array.reshape(-1))
        return [name, start, list(array.shape)]

    @property
    def arrays(self) -> Mapping[str, Sequence[AnyArray]]:
        """All arrays taken, by dtype."""
        return self._arrays

    def joined(self) -> dict[str, AnyArray]:
        """Return all arrays of a dtype end to end, by dtype."""
        return {name: np.concatenate(arrays) for name, arrays in self._arrays.items()}


class ArrayReader:
    """Hands out arrays by reference, each checked before it is used.

    Parameters
    ----------
    joined : (n,) arrays of each dtype joined end to end, by dtype
    is_finite : refuse numbers that are infinite or NaN, in arrays and in the tree

    Raises
    ------
    CacheError : an array must be finite and is not
    """

    def __init__(self, joined: dict[str, AnyArray], *, is_finite: bool = False) -> None:
        self.is_finite = is_finite
        self._joined = joined
        floats = [array for array in joined.values() if array.dtype.kind == "f"]
        if is_finite and not all(np.isfinite(array).all() for array in floats):
            raise CacheError("an array holds values that are not finite")

    def get(self, reference: Any) -> AnyArray:  # noqa: ANN401 - whatever JSON held
        """Return the array of a reference, as a view of the joined array.

        Raises
        ------
        CacheError : it is not a reference, or it ends outside the file
        """
        try:
            name, start, shape = reference
            stop = start + prod(shape)
            # numpy accepts negative slices and shapes, so they are refused here
            if not 0 <= start <= stop <= len(self._joined[name]) or min(shape, default=0) < 0:
                raise ValueError("ends outside the file")
            if start == stop and max(shape) > MAX_EMPTY_ROWS:
                raise ValueError("is empty, and longer than any")
            return self._joined[name][start:stop].reshape(shape)
        except (LookupError, OverflowError, TypeError, ValueError) as error:
            raise CacheError(f"{reference!r:.60} where an array is expected ({error})") from error


def pack(tree: dict[str, Any], arrays: Mapping[str, AnyArray | Sequence[AnyArray]]) -> bytes:
    """Return a file's bytes.

    Parameters
    ----------
    tree : JSON value
    arrays : by dtype, (n,) all arrays of it end to end, or these arrays, of one dimension each

    Raises
    ------
    TooLargeError : tree or arrays are too large to be read again
    """
    text = json.dumps(tree, separators=(",", ":")).encode()
    members = {
        name: [found] if isinstance(found, np.ndarray) else found for name, found in arrays.items()
    }
    array_bytes = sum(array.nbytes for pieces in members.values() for array in pieces)
    if len(text) > MAX_TREE_BYTES or array_bytes > MAX_BYTES - 2 * MAX_TREE_BYTES:
        raise TooLargeError(f"{len(text)} bytes of JSON, {array_bytes} bytes of arrays")
    members = {"tree": [np.frombuffer(text, dtype=np.uint8)], **members}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, pieces in members.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                _write_joined(member, pieces)
        archive.comment = b"0" * DIGEST_BYTES
    # in place, and without a second copy: the file of a large part is as large as the part
    with buffer.getbuffer() as view:
        view[-DIGEST_BYTES:] = _digest(view[:-DIGEST_BYTES])
    return buffer.getvalue()


def _write_joined(member: IO[bytes], pieces: Sequence[AnyArray]) -> None:
    """Write arrays of one dtype end to end, as numpy would write them joined."""
    descr = np.lib.format.dtype_to_descr(pieces[0].dtype)
    shape = (sum(len(array) for array in pieces),)
    np.lib.format.write_array_header_1_0(
        member, {"descr": descr, "fortran_order": False, "shape": shape}
    )
    for array in pieces:
        for begin in range(0, len(array), WRITTEN_AT_ONCE):
            member.write(array[begin : begin + WRITTEN_AT_ONCE].tobytes())


def sealed(data: bytes) -> bytes:
    """Return a file's bytes with their digest appended."""
    body = data[:-DIGEST_BYTES]
    return body + _digest(body)


def _digest(body: bytes | memoryview) -> bytes:
    return hashlib.sha256(body).hexdigest().encode()


def unpack(data: bytes) -> tuple[Any, dict[str, AnyArray]]:
    """Return tree and joined arrays of a file's bytes.

    Raises
    ------
    CacheError : another kind of file, cut short, or changed since it was written
    """
    if _digest(memoryview(data)[:-DIGEST_BYTES]) != data[-DIGEST_BYTES:]:
        raise CacheError("is damaged, or no file of this cache")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            members = archive.zip.infolist()
            if len(members) > 1 + len(DTYPES) or any(
                # a compressed member could unfold to more memory than the file takes
                member.compress_type != zipfile.ZIP_STORED or member.file_size > len(data)
                for member in members
            ):
                raise CacheError("has members that are not stored as they are")
            arrays = {name: archive[name] for name in archive.files}
        text = arrays.pop("tree")
        if text.dtype != np.uint8 or text.size > MAX_TREE_BYTES:
            raise CacheError("has no tree, or a longer one than any")
        for name, array in arrays.items():
            if name not in DTYPES or array.dtype != np.dtype(name) or array.ndim != 1:
                raise CacheError(f"has an array {name!r:.20} of {array.dtype} {array.shape}")
        return json.loads(text.tobytes()), arrays
    except CacheError:
        raise
    except Exception as error:  # parsers of zip, npy and JSON may raise anything on garbage
        raise CacheError(f"cannot be read ({type(error).__name__}: {error!s:.200})") from error


def read_file(path: Path) -> bytes:
    """Return a file's bytes.

    Raises
    ------
    OSError : it cannot be read
    CacheError : it is not a regular file, or is larger than any file of the cache
    """
    # without O_NONBLOCK, a pipe in its place would block for ever
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:  # noqa: PTH123  (Path.open takes no descriptor)
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_BYTES:
            raise CacheError("is no regular file, or a larger one than is ever written")
        return file.read(status.st_size)


def write_file(path: Path, data: bytes) -> None:
    """Write a file so that others see the old one or the whole new one, never a fragment.

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
