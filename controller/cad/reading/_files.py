"""CAD files of the usual kinds, read whole or refused; what they promise is checked first.

Triangle files go through trimesh, which reads much that is broken without a word: so lengths,
counts and text are checked before, and `make_solid` proves the rest.
"""

import hashlib
import io
import logging
import warnings
from pathlib import Path
from typing import Final, cast

import numpy as np
import trimesh

from controller.arrays import FloatArray, IntArray
from controller.config import CAD_FORMATS, split_cad
from controller.config.cad_files import MARK, STEP_FORMATS

from ..errors import UnreadableCadError
from ..solid import Merged, Solid, merge_corners, solid_of
from ..stages import OnStage, no_stage
from ._ahead import STL_HEADER_BYTES, STL_TRIANGLE_BYTES, check_ahead, read_file, size_of
from ._threemf import check_3mf
from .csg import read_csg
from .units import check_unit, read_unit

# what trimesh stumbles over is told once, by our errors, and not on the terminal besides
logging.getLogger("trimesh").addHandler(logging.NullHandler())

STL_TRIANGLE: Final = np.dtype(
    [("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
FORMAT_NAMES: Final = "STL, OBJ, PLY, OFF, 3MF, STEP, CSG text (.csg.yaml)"


def load_solid(path: Path, *, unit: str | None = None, on_stage: OnStage = no_stage) -> Solid:
    """Return the solid of a CAD file, proven to be one closed solid.

    Parameters
    ----------
    path : STL, OBJ, PLY, OFF, 3MF, STEP or CSG text; ``file.step#NAME`` is one body of several
    unit : of the file's lengths: mm, cm, m or inch. None: what the file says or, where its format
        has no place for it (STL, OBJ, PLY, OFF), millimetres, if these make a part of sense
    on_stage : called with the name of each stage as it begins

    Raises
    ------
    CadError : as its classes say; each names the file, the fault and what to do about it
    """
    source = split_cad(path)
    path, ending = source.file, source.ending
    if ending not in CAD_FORMATS:
        raise UnreadableCadError(
            f"{path}: format {path.suffix or 'without ending'} is not read; "
            f"export the part as one of {FORMAT_NAMES}"
        )
    if source.body is not None and ending not in STEP_FORMATS:
        raise UnreadableCadError(
            f"{path}: only a STEP file has bodies with names; leave out {MARK}{source.body}"
        )
    on_stage("reading the file")
    name, _ = read_unit(unit or "mm", path)
    size = size_of(path)
    if ending in STEP_FORMATS:
        from .step.files import read_step  # slow to import, and only needed here

        solid = read_step(path, source.body)
        check_unit(unit, solid.unit, path)
        return solid
    if ending == ".yaml":
        solid = read_csg(path)
        check_unit(unit, solid.unit, path)
        return solid
    check_ahead(path, ending, size)
    merged, content_hash, found = _read_merged(path, ending, unit)
    return solid_of(
        merged,
        path.stem,
        content_hash,
        where=str(path),
        unit=found or name,
        unit_is_declared=found is not None or unit is not None,
        on_stage=on_stage,
    )


def _read_merged(path: Path, ending: str, unit: str | None) -> tuple[Merged, str, str | None]:
    """Return a file's triangles in mm, its SHA-256, and the unit it names, if it names one.

    What was read, three corners a triangle, is given up before anything is worked out.
    """
    data, stated = read_file(path), None
    _, mm_per_unit = read_unit(unit or "mm", path)
    if ending == ".3mf":
        named = check_3mf(data, path)
        check_unit(unit, named, path)
        stated, mm_per_unit = read_unit(named, path)
    vertices, triangles = _read_mesh(data, path, ending)
    content_hash = hashlib.sha256(data).hexdigest()
    del data
    if mm_per_unit != 1.0:
        with np.errstate(over="ignore"):
            vertices = vertices * mm_per_unit
    is_declared = unit is not None or stated is not None
    merged = merge_corners(vertices, triangles, str(path), unit_is_declared=is_declared)
    return merged, content_hash, stated


def _read_mesh(data: bytes, path: Path, ending: str) -> tuple[FloatArray, IntArray]:
    """Return corners (v, 3) in the file's unit and triangles (n, 3).

    A stream has no folder, so that no file beside it (a texture, a material) is read unasked.
    """
    if ending == ".stl":
        count = int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
        if len(data) == STL_HEADER_BYTES + STL_TRIANGLE_BYTES * count:
            # binary; trimesh reads it as well, in three times the memory
            rows = np.frombuffer(data, STL_TRIANGLE, count, STL_HEADER_BYTES)
            corners = rows["corners"].astype(np.float64).reshape(-1, 3)
            return corners, np.arange(3 * count, dtype=np.int64).reshape(-1, 3)
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns where a text breaks off, and goes on
            # unprocessed: trimesh would drop triangles with broken coordinates without a word
            loaded = trimesh.load(
                io.BytesIO(data), file_type=ending[1:], force="mesh", process=False
            )
        mesh = cast("trimesh.Trimesh", loaded)  # forced to be one
        faces = np.asarray(mesh.faces, dtype=np.int64)
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
    except Exception as error:
        reason = " ".join(str(error).split())
        raise UnreadableCadError(
            f"{path}: cannot be read as {ending[1:].upper()} "
            f"({type(error).__name__}: {reason:.200}); export it again"
        ) from error
    if len(faces) and (faces.shape[1:] != (3,) or vertices.shape[1:] != (3,)):
        raise UnreadableCadError(
            f"{path}: its corners have other than three coordinates each; export it again"
        )
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise UnreadableCadError(
            f"{path}: a triangle names corner {int(faces.max())} of {len(vertices)}; "
            "export it again"
        )
    return vertices, faces
