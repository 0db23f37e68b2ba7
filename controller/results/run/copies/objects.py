"""Pictures in a store of objects, each named by the hash of its content: a copy proves itself.

A store is anything that fsspec has an address for: `s3://bucket/folder`, `file:///mnt/share`, and
more with further packages. Keys come from the environment, never from the address, which stands in
journals. What is read is checked by its hash, and nothing counts as copied before that.
"""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Final
from urllib.parse import urlsplit

from controller.config.object_address import object_address

from ..model import ResultsError

SUFFIXES: Final = (".png", ".pgm", ".tif", ".tiff", ".jpg", ".jpeg")
HASH_LENGTH: Final = 64
# By protocol. A share's folders are made as needed; a bucket that does not answer is given up
# after three tries of ten seconds: a person waits for the answer.
OPTIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "file": {"auto_mkdir": True},
    "s3": {
        "config_kwargs": {
            "connect_timeout": 10,
            "read_timeout": 60,
            "retries": {"mode": "standard", "max_attempts": 3},
        }
    },
}


class ObjectsError(ResultsError):
    """The store of objects cannot be opened, read or written."""


class WrongObjectError(ObjectsError):
    """An object is not there, or not what its name says: copying it again puts it right."""


class ChangedFileError(ObjectsError):
    """A file is not what the journal has of it: it is not copied under that name."""


def sha256(data: bytes) -> str:
    """Return the SHA-256 of bytes, as the journal has it."""
    return hashlib.sha256(data).hexdigest()


def object_name(digest: str, file: str) -> str:
    """Return the name of a picture in a store of objects: ``sha256/ab/abcd....png``.

    Parameters
    ----------
    digest : SHA-256 of its content
    file : its name in the run's folder, of which the suffix counts

    Raises
    ------
    ObjectsError : that is no SHA-256
    """
    if len(digest) != HASH_LENGTH or not set(digest) <= set("0123456789abcdef"):
        raise ObjectsError(f"{file}: {digest[:80]!r} is no SHA-256")
    suffix = PurePosixPath(file).suffix.lower()
    return f"sha256/{digest[:2]}/{digest}{suffix if suffix in SUFFIXES else ''}"


class ObjectStore:
    """An open store of objects.

    Parameters
    ----------
    url : its address, as `object_address` takes it

    Raises
    ------
    ObjectsError : the address is none, or a package for it is not installed
    """

    def __init__(self, url: str) -> None:
        try:
            self.url = object_address(url)
        except ValueError as error:
            raise ObjectsError(f"the store of objects: {error}") from error
        options = OPTIONS.get(urlsplit(url).scheme, {})
        try:
            from fsspec.core import url_to_fs

            self._fs, self._root = url_to_fs(
                self.url, skip_instance_cache=True, use_listings_cache=False, **options
            )
        except (ImportError, ValueError) as error:
            raise ObjectsError(f"{url}: {error} (pip install 'cellctl[objects]')") from error

    def put(self, path: Path, digest: str, file: str) -> None:
        """Copy a picture, unless it is there; read it back, and return once it is as it was.

        Parameters
        ----------
        path : the picture
        digest : its SHA-256 in the journal
        file : its name in the run's folder

        Raises
        ------
        ChangedFileError : the picture is not what the journal has
        ObjectsError : it could not be written, or was read back as something else
        OSError : the picture cannot be read
        """
        data = path.read_bytes()
        if sha256(data) != digest:
            raise ChangedFileError(
                f"{path}: is not as the journal has it (`cellctl verify`), so it is not copied"
            )
        try:
            self.read(digest, file)
        except WrongObjectError:  # not there yet, or a copy that was cut short or changed
            with self._told(object_name(digest, file)) as at:
                self._fs.pipe_file(at, data)
            self.read(digest, file)

    def read(self, digest: str, file: str) -> bytes:
        """Return a picture.

        Parameters
        ----------
        digest, file : as `object_name` takes them

        Raises
        ------
        WrongObjectError : it is not there, or has another content
        ObjectsError : the store cannot be read
        """
        name = object_name(digest, file)
        with self._told(name) as at:
            data = bytes(self._fs.cat_file(at))
        if (found := sha256(data)) != digest:
            raise WrongObjectError(
                f"{self.url}/{name}: was changed or cut short: {len(data)} bytes with the SHA-256 "
                f"{found[:12]}…"
            )
        return data

    @contextmanager
    def _told(self, name: str) -> Iterator[str]:
        """Yield the place of an object; tell what goes wrong there in a sentence."""
        try:
            yield f"{self._root}/{name}"
        except FileNotFoundError as error:
            raise WrongObjectError(f"{self.url}/{name}: is not there") from error
        except PermissionError as error:
            raise ObjectsError(
                f"{self.url}: access refused ({_first_line(error)}): check the key and its rights"
            ) from error
        except Exception as error:  # each kind of store has errors of its own
            raise ObjectsError(f"{self.url}: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0][:300] if text else type(error).__name__
