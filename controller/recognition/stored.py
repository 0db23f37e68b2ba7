"""A library of parts from CAD files; computed entries are kept in the cache.

A start reads a few kilobytes of each part; edges are read when a part turns up. So a library may
hold a thousand parts.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from controller.cache import DiskCache, digest_of, source_hash
from controller.cad import Solid
from controller.cad.compiled import CompileOptions, cache_key, load_part, part_name
from controller.imaging import Camera

from .fitting import EdgeShape, edge_shape
from .library import CameraPlace, Library, LibraryPart, check_fits, make_entry, station_of

FORMAT = 3  # raised when the same source comes to mean something else
ROOM = Path(__file__).parent


def open_library(
    files: Sequence[tuple[Path, CompileOptions]], camera: Camera, cache: Path | None = None
) -> Library:
    """Return the library of some CAD files for a camera.

    Parameters
    ----------
    files : CAD files and what they are compiled with
    camera : overhead, calibrated
    cache : folder, the compiled parts' otherwise

    Raises
    ------
    CadError : as in `load_part`; or a part does not fit into the camera's picture
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


def keep_entry(path: Path, options: CompileOptions, camera: Camera) -> None:
    """Compute a part's library entry for a camera, unless the cache has it.

    Parameters
    ----------
    path, options : CAD file and what it is compiled with
    camera : overhead, calibrated

    Raises
    ------
    CadError : as in `load_part`
    """
    _entry(path, options, station_of(camera), None)


def is_entry_kept(path: Path, options: CompileOptions, camera: Camera) -> bool:
    """Return True if the cache has a file of a part's library entry, sound or not.

    Parameters
    ----------
    path, options, camera : as for `keep_entry`
    """
    key = _key(path, options, station_of(camera))
    return key is not None and entry_cache().file(part_name(path), key, None).exists()


def _entry(
    path: Path, options: CompileOptions, station: CameraPlace, cache: Path | None
) -> LibraryPart:
    key = _key(path, options, station)
    if key is not None:
        found = entry_cache().load(entry_cache().file(part_name(path), key, cache))
        if found is not None:
            return found
    entry, shape = make_entry(load_part(path, options, cache), station)
    if key is not None:
        entry_cache().save(entry_cache().file(part_name(path), key, cache), entry)
        shape_cache().save(shape_cache().file(part_name(path), key, cache), shape)
    return entry


def _shape(
    path: Path, options: CompileOptions, station: CameraPlace, cache: Path | None
) -> EdgeShape:
    key = _key(path, options, station)
    if key is not None:
        found = shape_cache().load(shape_cache().file(part_name(path), key, cache))
        if found is not None:
            return found
    shape = edge_shape(load_part(path, options, cache).solid)
    if key is not None:
        shape_cache().save(shape_cache().file(part_name(path), key, cache), shape)
    return shape


@lru_cache(maxsize=4096)
def _key(path: Path, options: CompileOptions, station: CameraPlace) -> str | None:
    part = cache_key(path, options)
    if part is None:
        return None
    sources = source_hash(*(ROOM / folder for folder in ("library", "fitting", "grey")))
    return digest_of(FORMAT, part, part_name(path), station.eye_mm, station.reach_mm, sources)


@lru_cache(maxsize=1)
def entry_cache() -> DiskCache[LibraryPart]:
    """Return the cache of library entries."""
    return DiskCache(LibraryPart, "views", "views of a part")


@lru_cache(maxsize=1)
def shape_cache() -> DiskCache[EdgeShape]:
    """Return the cache of edge shapes."""
    return DiskCache(EdgeShape, "edges", "edges of a part")
