"""Cache of compiled parts, one file each; a file that fails its checks is not used.

A file's name holds the part and a key: hash of the CAD file and its references, ending, body,
options, format, our own source and the libraries that decide. Any change gives another key and
another file, so files never become stale. The file repeats the key, and has the shapes of its
arrays and a digest. Samples for another smallest defect are in files beside it.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from controller.cache import DiskCache, digest_of, source_hash, versions
from controller.config import STEP_FORMATS, split_cad
from controller.config.cad_files import MARK, MAX_CAD_BYTES
from messages import key

from ..reading import digests_of
from ..solid import Solid
from ..stages import OnStage, no_stage
from ..surfaces import SurfaceSamples, counted_samples
from ._mesh import called, solids
from .part import CompiledPart, CompileOptions, compile_part, part_name

FORMAT = 3  # raised when the same source and options come to mean something else
SOURCES = tuple(Path(__file__).parents[2] / room for room in ("cad", "imaging", "step_kernel"))
# Packages whose version decides the content of a file.
DECIDING = ("numpy", "scipy", "trimesh", "manifold3d", "embreex")


def load_part(
    path: Path,
    options: CompileOptions | None = None,
    cache: Path | None = None,
    on_stage: OnStage = no_stage,
) -> CompiledPart:
    """Return a compiled part, from the cache if that has a sound one.

    Parameters
    ----------
    path : CAD file
    options : compile options
    cache : folder, `cache_dir` otherwise; one that cannot be written costs time, not correctness
    on_stage : callback, called with the name of each stage as it begins

    Raises
    ------
    CadError : as in `load_solid`
    """
    on_stage(key("looking into the cache"))
    return cached_part(path, options, cache) or make_part(path, options, cache, on_stage)


def cached_part(
    path: Path, options: CompileOptions | None = None, cache: Path | None = None
) -> CompiledPart | None:
    """Return the cached compiled part of a CAD file, None where the cache has no sound one.

    Parameters
    ----------
    path : CAD file; what is kept goes by its content, and by the options
    options : compile options used; None for the defaults
    cache : folder; None for `cache_dir`
    """
    options = options or CompileOptions()
    file = _file_of(path, options, cache)
    if file is None:
        return None
    part = part_cache().load(file)
    if part is None:
        return None
    return _sampled(replace(part, solid=called(part.solid, part_name(path))), options, file)


def is_kept(path: Path, options: CompileOptions | None = None, cache: Path | None = None) -> bool:
    """Return True if the cache has a file of a CAD file's compiled part, sound or not.

    Parameters
    ----------
    path, options, cache : as for `cached_part`, which reads the file
    """
    file = _file_of(path, options or CompileOptions(), cache)
    return file is not None and file.exists()


def make_part(
    path: Path,
    options: CompileOptions | None = None,
    cache: Path | None = None,
    on_stage: OnStage = no_stage,
) -> CompiledPart:
    """Compile a part, keep it in the cache and return it.

    Parameters
    ----------
    path : CAD file
    options : compile options; None for the defaults
    cache : folder, None for `cache_dir`; one that cannot be written costs time, not correctness
    on_stage : callback, called with the name of each stage as it begins

    Raises
    ------
    CadError : as in `load_solid`
    """
    options = options or CompileOptions()
    file = _file_of(path, options, cache)
    part = compile_part(path, _usual(options), on_stage)
    if file is None or file != _file_of(path, options, cache):
        # the CAD file was written to meanwhile: what was read may be either
        return _sampled(part, options, None)
    on_stage(key("keeping what was found"))
    part_cache().save(file, part)
    # what the next start will get, so that the first run and the second are the same
    return _sampled(part_cache().load(file) or part, options, file)


def _usual(options: CompileOptions) -> CompileOptions:
    """Return the options of a compiled part's file; other samples have files of their own."""
    return replace(options, sample_spacing_mm=CompileOptions().sample_spacing_mm)


def _sampled(part: CompiledPart, options: CompileOptions, file: Path | None) -> CompiledPart:
    """Return a part with the samples that its options are for.

    Parameters
    ----------
    part : part with the usual samples
    options : compile options used
    file : file of the part in the cache, beside which its samples are kept; None to keep none
    """
    if options == _usual(options):
        return part
    kept = None
    if file is not None:
        key = digest_of(file.stem, options.sample_spacing_mm)
        kept = samples_cache().file(part.solid.name, key, file.parent)
    samples = None if kept is None else samples_cache().load(kept)
    if samples is None or not _is_of(samples, part):
        samples = counted_samples(part.solid, options.sample_spacing_mm)
        if kept is not None:
            samples_cache().save(kept, samples)
    return replace(part, samples=samples, smallest_defect_mm=options.smallest_defect_mm)


def _is_of(samples: SurfaceSamples, part: CompiledPart) -> bool:
    """Return True if samples fit a part: the same faces and the same area."""
    own = part.samples
    same_faces = np.array_equal(np.unique(samples.face_ids), np.unique(own.face_ids))
    return same_faces and bool(np.isclose(samples.areas_mm2.sum(), own.areas_mm2.sum()))


def _check_samples(samples: SurfaceSamples) -> None:
    """Check that samples are rows of one table.

    Raises
    ------
    ValueError : they are not
    """
    count, ids = len(samples.points_mm), samples.face_ids
    shapes = [a.shape for a in (samples.points_mm, samples.normals, ids, samples.areas_mm2)]
    if shapes != [(count, 3), (count, 3), (count,), (count,)]:
        raise ValueError(f"samples of {shapes}")


@lru_cache(maxsize=1)
def part_cache() -> DiskCache[CompiledPart]:
    """Return the cache of compiled parts."""
    return DiskCache(CompiledPart, "part", "a compiled part", {Solid: solids()})


@lru_cache(maxsize=1)
def samples_cache() -> DiskCache[SurfaceSamples]:
    """Return the cache of samples for other than the usual smallest defect."""
    return DiskCache(SurfaceSamples, "samples", "samples of a part", check=_check_samples)


def _file_of(path: Path, options: CompileOptions, cache: Path | None) -> Path | None:
    """Return the cache file of a CAD file's compiled part, None for an unreadable CAD file."""
    key = cache_key(path, options)
    if key is None:
        return None
    return part_cache().file(part_name(path), key, cache)


def cache_key(path: Path, options: CompileOptions) -> str | None:
    """Return the cache key of a compiled part, None where its CAD file cannot be read."""
    source = split_cad(path)
    try:
        # a pipe or a device would keep us for ever, what is larger is refused before it is read
        if not source.file.is_file() or source.file.stat().st_size > MAX_CAD_BYTES:
            return None
        contents = digests_of(source.file)
    except OSError:
        return None  # reading it tells why
    is_step = source.ending in STEP_FORMATS
    libraries = (*DECIDING, "cadquery-ocp-novtk") if is_step else DECIDING
    body = "" if source.body is None else f"{MARK}{source.body}"
    return digest_of(
        FORMAT,
        "\n".join(contents),
        f"{source.ending}{body}",
        _usual(options),
        source_hash(*SOURCES),
        versions(*libraries),
    )
