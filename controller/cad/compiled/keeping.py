"""Files for what later rooms work out of a compiled part, kept as compiled parts are.

A file is named by what it was made from; it is whole, of the right kind and of that name, or it
is not believed and made anew.
"""

import hashlib
import logging
from pathlib import Path
from typing import Generic, TypeVar

from ._cache import ENDING, cache_dir, cache_key
from ._codec import make_codec
from ._columns import CodecError, Reader, Writer
from ._container import pack, read_file, unpack, write_file

T = TypeVar("T")

log = logging.getLogger(__name__)

__all__ = ["Keeper", "cache_key"]


class Keeper(Generic[T]):
    """Keeps values of one type in files of the cache.

    Parameters
    ----------
    kind : dataclass of arrays, numbers, words, and of such dataclasses
    prefix : of the files' names

    Raises
    ------
    TypeError : a type that cannot be stored
    """

    def __init__(self, kind: type[T], prefix: str) -> None:
        self._kind = kind
        self._prefix = prefix
        self._codec = make_codec(kind)
        self._schema = hashlib.sha256(self._codec.says.encode()).hexdigest()

    def file(self, name: str, key: str, cache: Path | None = None) -> Path:
        """Return where a value is kept."""
        stem = name.encode()[:60].decode(errors="ignore")
        return (cache or cache_dir()) / f"{self._prefix}-{stem}-{key[:32]}{ENDING}"

    def load(self, file: Path) -> T | None:
        """Return a kept value, None where nothing sound is there."""
        try:
            header, arrays = unpack(read_file(file))
            if (header.get("key"), header.get("schema")) != (file.stem, self._schema):
                raise CodecError("is of another version")
            (value,) = self._codec.read(header.get("tree"), 1, Reader(arrays))
        except FileNotFoundError:
            return None
        except (
            ArithmeticError,
            CodecError,
            LookupError,
            MemoryError,
            OSError,
            RecursionError,
            TypeError,
            ValueError,
        ) as error:
            log.warning("%s: %s; it is made anew", file, error)
            return None
        assert isinstance(value, self._kind)
        return value

    def save(self, file: Path, value: T) -> None:
        """Keep a value; a full or read-only disk costs time at the next start, not correctness."""
        to = Writer()
        tree = self._codec.write([value], to)
        header = {"key": file.stem, "schema": self._schema, "tree": tree}
        try:
            write_file(file, pack(header, to.arrays))
        except OSError as error:
            log.warning("%s: cannot be kept (%s)", file, error)
