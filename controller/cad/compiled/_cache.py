"""Compiled parts kept on disk, one file each, trusted only as far as they prove themselves.

A file's name holds the part and a key: hash of the CAD file, its ending, the options, the format,
our own source and the libraries that decide. Another key is another file; so nothing has to be
found out about an old one. The file repeats the key, the shape of what it holds, and a digest.
"""

import hashlib
import importlib.metadata
import json
import logging
import os
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy
import trimesh

from ..solid import Solid
from ._codec import make_codec
from ._columns import Codec, CodecError, Reader, Writer
from ._container import pack, read_file, unpack, write_file
from ._mesh import Solids, called
from ._part import CompiledPart, CompileOptions, compile_part, part_name

FORMAT = 1  # raised when the same source and options come to mean something else
KEPT_FILES = 200  # the oldest ones go first; each can be computed again
ENDING = ".cell"
MOST_BYTES = 2**30

log = logging.getLogger(__name__)


def cache_dir() -> Path:
    """Return the folder for what can always be computed again."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "cellctl"


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
    try:
        part = decode_part(read_file(file), file.stem)
    except FileNotFoundError:
        return None
    except (OSError, MemoryError, CodecError) as error:
        log.warning("%s %s; it is made anew", file, error)
        return None
    return replace(part, solid=called(part.solid, part_name(path)))


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
    try:
        write_file(file, data)
        _tidy(file.parent)
    except OSError as error:
        log.warning("%s: cannot be kept (%s); the next start compiles it again", file, error)
    # what the next start will get, so that the first run and the second are the same
    return decode_part(bytearray(data), file.stem)


def encode_part(part: CompiledPart, key: str) -> bytes:
    """Return a compiled part as the bytes of a file.

    Raises
    ------
    TypeError : it holds what its annotations do not allow
    """
    to = Writer()
    tree = _codec().write([part], to)
    return pack({"key": key, "format": FORMAT, "schema": _schema(), "tree": tree}, to.arrays)


def decode_part(data: bytearray, key: str) -> CompiledPart:
    """Return the compiled part in a file's bytes; its arrays are views of ``data``.

    Raises
    ------
    CodecError : damaged, of another version, or of another part
    """
    header, arrays = unpack(data)
    if (header.get("format"), header.get("schema")) != (FORMAT, _schema()):
        raise CodecError("is of another version")
    if header.get("key") != key:
        raise CodecError("is of another part or other options")
    try:
        (part,) = _codec().read(header.get("tree"), 1, Reader(arrays))
    except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise CodecError(f"does not hold a compiled part ({error})") from error
    assert isinstance(part, CompiledPart)
    return part


@lru_cache(maxsize=1)
def _codec() -> Codec:
    return make_codec(CompiledPart, {Solid: Solids()})


@lru_cache(maxsize=1)
def _schema() -> str:
    return hashlib.sha256(_codec().says.encode()).hexdigest()


def _file_of(path: Path, options: CompileOptions, cache: Path | None) -> Path | None:
    """Return where a CAD file's compiled part is kept, None where the file cannot be read."""
    key = cache_key(path, options)
    if key is None:
        return None
    stem = part_name(path).encode()[:60].decode(errors="ignore")
    return (cache or cache_dir()) / f"part-{stem}-{key[:32]}{ENDING}"


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
    """Return a hash of this room's own source: what it computes changes with it."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for source in sorted(root.rglob("*.py")):
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


def _tidy(folder: Path) -> None:
    """Remove the oldest files where there are too many."""
    ages = []
    for file in folder.glob(f"part-*{ENDING}"):
        try:
            ages.append((file.stat().st_mtime, file))
        except FileNotFoundError:
            continue  # another process tidies too
    for _, file in sorted(ages)[:-KEPT_FILES]:
        file.unlink(missing_ok=True)
