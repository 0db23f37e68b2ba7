"""Values of one type in files of one folder, trusted only as far as they prove themselves.

A file repeats the key it is named by. It is whole, of that key and of the right types, or it is a
miss and is made anew. A folder that cannot be written costs time, not correctness.
"""

import gc
import logging
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, TypeVar

from ._types import Codec, make_codec
from .file import (
    ArrayReader,
    ArrayWriter,
    CacheError,
    TooLargeError,
    pack,
    read_file,
    unpack,
    write_file,
)

T = TypeVar("T")
FORMAT = 2  # raised when the same annotations come to be stored otherwise; 1 was no .npz
ENDING = ".npz"
MAX_FOLDER_BYTES = 2**31  # of all files of one prefix

log = logging.getLogger(__name__)


def cache_dir() -> Path:
    """Return the folder for what can always be computed again."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "cellctl"


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep the collector from searching ten thousands of new objects, none of which is garbage."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class DiskCache(Generic[T]):
    """Values of one type, each in a file of its own.

    Parameters
    ----------
    kind : dataclass of arrays, numbers, words, and of such dataclasses
    prefix : of the files' names
    what : it is called in messages
    special : codecs of types that have no annotations to go by
    check : raises ValueError where a value read, of the right types, cannot be; no number of it
        may then be infinite or NaN
    max_count : the oldest files are removed where there are more; None limits their bytes alone

    Raises
    ------
    TypeError : a type that cannot be stored
    """

    def __init__(
        self,
        kind: type[T],
        prefix: str,
        what: str,
        special: Mapping[Any, Codec] | None = None,
        *,
        check: Callable[[T], None] | None = None,
        max_count: int | None = None,
    ) -> None:
        self._kind = kind
        self._prefix = prefix
        self._what = what
        self._check = check
        self._max_count = max_count
        self._codec = make_codec(kind, special)

    def file(self, name: str, key: str, folder: Path | None = None) -> Path:
        """Return where a value is kept.

        Parameters
        ----------
        name : for people who look into the folder
        key : hash of all that decides the value
        folder : `cache_dir` where None
        """
        stem = name.encode()[:60].decode(errors="ignore")
        return (folder or cache_dir()) / f"{self._prefix}-{stem}-{key[:32]}{ENDING}"

    def encode(self, value: T, key: str) -> bytes:
        """Return a value as the bytes of a file.

        Raises
        ------
        TypeError : it holds what its annotations do not allow
        TooLargeError : it is larger than what is read again
        """
        to = ArrayWriter()
        tree = {"format": FORMAT, "key": key, "value": self._codec.write(value, to)}
        return pack(tree, to.joined())

    def decode(self, data: bytes, key: str) -> T:
        """Return the value in a file's bytes.

        Raises
        ------
        CacheError : damaged, of another version, or of another key
        """
        with _no_collection():
            return self._decoded(data, key)

    def _decoded(self, data: bytes, key: str) -> T:
        tree, arrays = unpack(data)
        if not isinstance(tree, dict) or tree.get("format") != FORMAT:
            raise CacheError("is of another version")
        if tree.get("key") != key:
            raise CacheError("is of another key")
        try:
            reader = ArrayReader(arrays, is_finite=self._check is not None)
            value = self._codec.read(tree.get("value"), reader)
            assert isinstance(value, self._kind)
            if self._check is not None:
                self._check(value)
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise CacheError(f"does not hold {self._what} ({error})") from error
        return value

    def load(self, file: Path) -> T | None:
        """Return a kept value, None where nothing sound is there."""
        try:
            return self.decode(read_file(file), file.stem)
        except FileNotFoundError:
            return None
        except (OSError, MemoryError, CacheError) as error:
            log.warning("%s %s; it is made anew", file, error)
            return None

    def save(self, file: Path, value: T) -> None:
        """Keep a value, and remove what the folder has too much of.

        A full or read-only disk costs time at the next start, not correctness.

        Raises
        ------
        TypeError : it holds what its annotations do not allow
        """
        try:
            write_file(file, self.encode(value, file.stem))
            self._tidy(file)
        except (OSError, TooLargeError) as error:
            log.warning("%s: cannot be kept (%s); the next start works it out again", file, error)

    def _tidy(self, newest: Path) -> None:
        """Remove the oldest files where there are too many, or too many bytes of them."""
        found = []
        for file in newest.parent.glob(f"{self._prefix}-*{ENDING}"):
            try:
                status = file.stat()
            except FileNotFoundError:
                continue  # another process tidies too
            found.append((file == newest, status.st_mtime, status.st_size, file))
        found.sort(key=lambda entry: entry[:3], reverse=True)
        room, count = MAX_FOLDER_BYTES, self._max_count or len(found)
        for number, (is_newest, _, size, file) in enumerate(found):
            room -= size
            if not is_newest and (number >= count or room < 0):
                file.unlink(missing_ok=True)
