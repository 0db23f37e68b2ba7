"""Results on disk that can always be computed again, safe to read from anybody's folder.

A file of the cache is an ordinary ``.npz``: a tree in JSON, validated against the annotations of
the type it was written from, and arrays of numbers beside it. Nothing in it can run. Its name comes
from everything that decides its content. A damaged, planted or foreign file counts as a miss.
"""

from ._keys import digest_of, source_hash, versions
from ._types import Codec, converted, given, make_codec, one_of
from .disk import DiskCache, cache_dir
from .file import CacheError

__all__ = [
    "CacheError",
    "Codec",
    "DiskCache",
    "cache_dir",
    "converted",
    "digest_of",
    "given",
    "make_codec",
    "one_of",
    "source_hash",
    "versions",
]
