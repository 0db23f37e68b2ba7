"""A library of parts from CAD files: what was worked out once is kept in the cache.

A start reads a few kilobytes of each part; edges are read when a part turns up. So a library may
hold a thousand parts.
"""

import hashlib
import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from controller.cad import Solid
from controller.cad.compiled import CompileOptions, cache_key, load_part, part_name
from controller.cad.compiled.keeping import Keeper
from controller.imaging import Camera

from .fitting import EdgeShape, edge_shape
from .library import Entry, Library, Station, check_fits, make_entry, station_of

FORMAT = 1  # raised when the same source comes to mean something else


def open_library(
    files: Sequence[tuple[Path, CompileOptions]], camera: Camera, cache: Path | None = None
) -> Library:
    """Return the library of some CAD files for a camera.

    Parameters
    ----------
    files : CAD files and what they are compiled with
    cache : folder, the compiled parts' otherwise

    Raises
    ------
    CadError : as `load_part`; or a part does not fit into the camera's picture
    """
    station = station_of(camera)
    entries = []
    for path, options in files:
        entry = _entry(path, options, station, cache)
        check_fits(entry, camera)
        entries.append(entry)

    def shape_of(number: int) -> EdgeShape:
        path, options = files[number]
        return _shape(path, options, station, cache)

    def solid_of(number: int) -> Solid:
        return load_part(*files[number], cache).solid

    return Library(entries, shape_of, solid_of, camera.position_mm)


def _entry(path: Path, options: CompileOptions, station: Station, cache: Path | None) -> Entry:
    key = _key(path, options, station)
    if key is not None:
        found = _entries().load(_entries().file(part_name(path), key, cache))
        if found is not None:
            return found
    entry, shape = make_entry(load_part(path, options, cache), station)
    if key is not None:
        _entries().save(_entries().file(part_name(path), key, cache), entry)
        _shapes().save(_shapes().file(part_name(path), key, cache), shape)
    return entry


def _shape(path: Path, options: CompileOptions, station: Station, cache: Path | None) -> EdgeShape:
    key = _key(path, options, station)
    if key is not None:
        found = _shapes().load(_shapes().file(part_name(path), key, cache))
        if found is not None:
            return found
    shape = edge_shape(load_part(path, options, cache).solid)
    if key is not None:
        _shapes().save(_shapes().file(part_name(path), key, cache), shape)
    return shape


@lru_cache(maxsize=4096)
def _key(path: Path, options: CompileOptions, station: Station) -> str | None:
    part = cache_key(path, options)
    if part is None:
        return None
    asked = [FORMAT, part, part_name(path), station.eye_mm, station.reach_mm, _source_hash()]
    return hashlib.sha256(json.dumps(asked).encode()).hexdigest()


@lru_cache(maxsize=1)
def _entries() -> Keeper[Entry]:
    return Keeper(Entry, "views", "views of a part")


@lru_cache(maxsize=1)
def _shapes() -> Keeper[EdgeShape]:
    return Keeper(EdgeShape, "edges", "edges of a part")


@lru_cache(maxsize=1)
def _source_hash() -> str:
    """Return a hash of what decides of what is kept: changed rules make it void."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for folder in ("library", "fitting", "grey"):
        for source in sorted((root / folder).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()
