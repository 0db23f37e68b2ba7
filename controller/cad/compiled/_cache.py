"""Compiled parts kept on disk, one file each, trusted only as far as they prove themselves.

A file's name holds the part and a key: hash of the CAD file, its ending, the options, the format,
our own source and the libraries that decide. Another key is another file; so nothing has to be
found out about an old one. The file repeats the key, the shape of what it holds, and a digest.
"""

import hashlib
import importlib.metadata
import json
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy
import trimesh

from ..solid import Solid
from ._mesh import Solids, called
from ._part import CompiledPart, CompileOptions, compile_part, part_name
from .keeping import Keeper

FORMAT = 1  # raised when the same source and options come to mean something else
KEPT_FILES = 200  # the oldest ones go first; each can be computed again
MOST_BYTES = 2**30


def load_part(
    path: Path, options: CompileOptions | None = None, cache: Path | None = None
) -> CompiledPart:
    """Return a compiled part, from the cache where it is there and sound.

    Parameters
    ----------
    path : CAD file
    options : what it is compiled with
    cache : folder, `cache_dir` otherwise; one that cannot be written costs time, not correctness

    Raises
    ------
    CadError : as `load_solid`
    """
    return cached_part(path, options, cache) or make_part(path, options, cache)


def cached_part(
    path: Path, options: CompileOptions | None = None, cache: Path | None = None
) -> CompiledPart | None:
    """Return what is kept of a CAD file, None where nothing sound is there."""
    file = _file_of(path, options or CompileOptions(), cache)
    if file is None:
        return None
    part = _parts().load(file, FORMAT)
    return part and replace(part, solid=called(part.solid, part_name(path)))


def make_part(
    path: Path, options: CompileOptions | None = None, cache: Path | None = None
) -> CompiledPart:
    """Compile a part and keep it.

    Raises
    ------
    CadError : as `load_solid`
    """
    options = options or CompileOptions()
    file = _file_of(path, options, cache)
    part = compile_part(path, options)
    if file is None or file != _file_of(path, options, cache):
        return part  # the CAD file was written to meanwhile: what was read may be either
    data = encode_part(part, file.stem)
    if _parts().write(file, data):
        _parts().tidy(file.parent, KEPT_FILES)
    # what the next start will get, so that the first run and the second are the same
    return decode_part(bytearray(data), file.stem)


def encode_part(part: CompiledPart, key: str) -> bytes:
    """Return a compiled part as the bytes of a file.

    Raises
    ------
    TypeError : it holds what its annotations do not allow
    """
    return _parts().encode(part, key, FORMAT)


def decode_part(data: bytearray, key: str) -> CompiledPart:
    """Return the compiled part in a file's bytes; its arrays are views of ``data``.

    Raises
    ------
    CodecError : damaged, of another version, or of another part
    """
    return _parts().decode(data, key, FORMAT)


@lru_cache(maxsize=1)
def _parts() -> Keeper[CompiledPart]:
    return Keeper(CompiledPart, "part", "a compiled part", {Solid: Solids()})


def _file_of(path: Path, options: CompileOptions, cache: Path | None) -> Path | None:
    """Return where a CAD file's compiled part is kept, None where the file cannot be read."""
    key = cache_key(path, options)
    if key is None:
        return None
    return _parts().file(part_name(path), key, cache)


def cache_key(path: Path, options: CompileOptions) -> str | None:
    """Return what tells one compiled part from another, None where the file cannot be read."""
    try:
        # a pipe or a device would keep us for ever, what is larger is refused before it is read
        if not path.is_file() or path.stat().st_size > MOST_BYTES:
            return None
        with path.open("rb") as file:
            content = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None  # reading it tells why
    ending = path.suffix.lower()
    asked = [FORMAT, content, ending, asdict(options), source_hash(), *_versions(ending)]
    return hashlib.sha256(json.dumps(asked).encode()).hexdigest()


@lru_cache(maxsize=1)
def source_hash() -> str:
    """Return a hash of the source of cad and imaging: what is computed changes with it."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for room in ("cad", "imaging"):
        for source in sorted((root / room).rglob("*.py")):
            digest.update(source.relative_to(root).as_posix().encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=8)
def _versions(ending: str) -> tuple[str, ...]:
    """Return the versions of the libraries that decide what a file of this kind becomes."""
    deciding = ["manifold3d", "embreex"]
    if ending in {".step", ".stp"}:
        deciding.append("cadquery-ocp-novtk")
    return np.__version__, scipy.__version__, trimesh.__version__, *map(_version, deciding)


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "none"
