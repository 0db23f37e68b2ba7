"""Files for what can always be computed again, trusted only as far as they prove themselves.

A file is named by what it was made from. It repeats that key, the shape of what it holds, and a
digest: it is whole, of the right kind and of that name, or it is not believed and made anew.
"""

import hashlib
import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from ._codec import make_codec, one_of
from ._columns import Codec, CodecError, Given, Reader, Writer
from ._container import pack, read_file, unpack, write_file
from ._mesh import Solids

__all__ = ["Codec", "CodecError", "Given", "Keeper", "Solids", "cache_dir", "one_of"]

T = TypeVar("T")
ENDING = ".cell"

log = logging.getLogger(__name__)


def cache_dir() -> Path:
    """Return the folder for what can always be computed again."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "cellctl"


class Keeper(Generic[T]):
    """Keeps values of one type in files of the cache.

    Parameters
    ----------
    kind : dataclass of arrays, numbers, words, and of such dataclasses
    prefix : of the files' names
    what : it is called in messages
    special : codecs of types that have no annotations to go by
    check : raises ValueError where a value read, of the right types, cannot be; no array of it
        may then hold an infinity or what is no number
    kept_count : the oldest files go where there are more; None keeps them all

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
        kept_count: int | None = None,
    ) -> None:
        self._kind = kind
        self._prefix = prefix
        self._what = what
        self._check = check
        self._kept_count = kept_count
        self._codec = make_codec(kind, special)
        self._schema = hashlib.sha256(self._codec.says.encode()).hexdigest()

    def file(self, name: str, key: str, cache: Path | None = None) -> Path:
        """Return where a value is kept."""
        stem = name.encode()[:60].decode(errors="ignore")
        return (cache or cache_dir()) / f"{self._prefix}-{stem}-{key[:32]}{ENDING}"

    def encode(self, value: T, key: str, version: int = 1) -> bytes:
        """Return a value as the bytes of a file.

        Raises
        ------
        TypeError : it holds what its annotations do not allow
        """
        to = Writer()
        tree = self._codec.write([value], to)
        header = {"key": key, "format": version, "schema": self._schema, "tree": tree}
        return pack(header, to.arrays)

    def decode(self, data: bytearray, key: str, version: int = 1) -> T:
        """Return the value in a file's bytes; its arrays are views of ``data``.

        Raises
        ------
        CodecError : damaged, of another version, or of another key
        """
        header, arrays = unpack(data)
        if (header.get("format"), header.get("schema")) != (version, self._schema):
            raise CodecError("is of another version")
        if header.get("key") != key:
            raise CodecError("is of another part or other options")
        try:
            reader = Reader(arrays, is_finite=self._check is not None)
            (value,) = self._codec.read(header.get("tree"), 1, reader)
            assert isinstance(value, self._kind)
            if self._check is not None:
                self._check(value)
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise CodecError(f"does not hold {self._what} ({error})") from error
        return value

    def load(self, file: Path, version: int = 1) -> T | None:
        """Return a kept value, None where nothing sound is there."""
        try:
            return self.decode(read_file(file), file.stem, version)
        except FileNotFoundError:
            return None
        except (OSError, MemoryError, CodecError) as error:
            log.warning("%s %s; it is made anew", file, error)
            return None

    def save(self, file: Path, value: T, version: int = 1) -> None:
        """Keep a value; a full or read-only disk costs time at the next start, not correctness."""
        self.write(file, self.encode(value, file.stem, version))

    def write(self, file: Path, data: bytes) -> bool:
        """Write a file's bytes; tell whether that went well."""
        try:
            write_file(file, data)
        except OSError as error:
            log.warning("%s: cannot be kept (%s); the next start works it out again", file, error)
            return False
        if self._kept_count is not None:
            self.tidy(file.parent, self._kept_count)
        return True

    def tidy(self, folder: Path, kept_count: int) -> None:
        """Remove the oldest files where there are too many."""
        ages = []
        for file in folder.glob(f"{self._prefix}-*{ENDING}"):
            try:
                ages.append((file.stat().st_mtime, file))
            except FileNotFoundError:
                continue  # another process tidies too
        for _, file in sorted(ages)[: max(0, len(ages) - kept_count)]:
            file.unlink(missing_ok=True)
