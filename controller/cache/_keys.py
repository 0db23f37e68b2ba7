"""Hash everything that decides a result: values, source, versions of libraries."""

import hashlib
import importlib.metadata
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path

import numpy as np


def digest_of(*values: object) -> str:
    """Return a hash of numbers, words, arrays, and of dataclasses and collections of these.

    Raises
    ------
    TypeError : any other type, since its hash might leave out a part of its content
    """
    digest = hashlib.sha256()
    for piece in _pieces(values):
        digest.update(len(piece).to_bytes(8, "little"))
        digest.update(piece)
    return digest.hexdigest()


@lru_cache(maxsize=16)
def source_hash(*folders: Path) -> str:
    """Return a hash of all source in some folders, since results change with the source."""
    digest = hashlib.sha256()
    for folder in folders:
        for source in sorted(folder.rglob("*.py")):
            digest.update(source.relative_to(folder).as_posix().encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=16)
def versions(*packages: str) -> tuple[str, ...]:
    """Return the versions of some packages, "none" for one that is not installed."""
    return tuple(map(_version, packages))


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "none"


def _pieces(value: object) -> Iterable[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif value is None or isinstance(value, bool | int | float | str | Enum | np.generic):
        yield f"{type(value).__name__} {value!r}".encode()
    elif is_dataclass(value):
        yield type(value).__name__.encode()
        for field in fields(value):
            yield field.name.encode()
            yield from _pieces(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, item in value.items():
            yield from _pieces(key)
            yield from _pieces(item)
    elif isinstance(value, tuple | list | frozenset):
        items = sorted(value, key=repr) if isinstance(value, frozenset) else value
        yield f"{type(value).__name__} {len(value)}".encode()
        for item in items:
            yield from _pieces(item)
    else:
        raise TypeError(f"{type(value).__name__} cannot be part of a key")
