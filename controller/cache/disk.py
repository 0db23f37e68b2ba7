"""Keep values of one type in files of one folder; trust a file only after checking it.

A file contains the key from which its name is made. If it is damaged, of another key or of other
types, it counts as a miss and is made again. A folder that cannot be written costs time, not
correctness.
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
# Raise this number when the same annotations are stored in another way. Format 1 was not .npz.
FORMAT = 3
ENDING = ".npz"
MAX_FOLDER_BYTES = 2**31  # Largest total size of the files with one prefix [bytes].

log = logging.getLogger(__name__)


def cache_dir() -> Path:
    """Return the folder of the cache."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "cellctl"


@contextmanager
def _no_collection() -> Iterator[None]:
    """Switch off garbage collection while tens of thousands of objects are made, none garbage."""
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
    prefix : prefix of the files' names
    what : name of such a value in messages
    special : codecs of types without annotations
    check : raises ValueError for a value of the right types that cannot be right; with a check,
        infinite numbers and NaN are refused, too
    max_count : the oldest files above this count are removed; None limits only the bytes

    Raises
    ------
    TypeError : a type cannot be stored
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
        folder : None for `cache_dir`
        """
        stem = name.encode()[:60].decode(errors="ignore")
        return (folder or cache_dir()) / f"{self._prefix}-{stem}-{key[:32]}{ENDING}"

    def encode(self, value: T, key: str) -> bytes:
        """Return a value as the bytes of a file.

        Raises
        ------
        TypeError : it holds what its annotations do not allow
        TooLargeError : it is too large to be read again
        """
        to = ArrayWriter()
        tree = {"format": FORMAT, "key": key, "value": self._codec.write(value, to)}
        return pack(tree, to.arrays)

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
        """Return a kept value, None if there is no file or an unsound one."""
        try:
            return self.decode(read_file(file), file.stem)
        except FileNotFoundError:
            return None
        except (OSError, MemoryError, CacheError) as error:
            log.warning("%s %s; it is made anew", file, error)
            return None

    def save(self, file: Path, value: T) -> None:
        """Keep a value, and remove the oldest files if the folder has too many.

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
        """Remove the oldest files while there are too many, or too many bytes in them."""
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
