"""CAD files of the usual kinds, read whole or refused; `make_solid` proves the result."""

import hashlib
from pathlib import Path
from typing import Final

import numpy as np

from controller.config import CAD_FORMATS, split_cad
from controller.config.cad_files import MARK, STEP_FORMATS

from ..errors import UnreadableCadError
from ..solid import Merged, Solid, merge_corners, solid_of
from ..stages import OnStage, no_stage
from ._ahead import check_ahead, read_file, size_of
from .csg import read_csg
from .meshes import TRIANGLE_READERS, read_3mf
from .units import check_unit, read_unit

FORMAT_NAMES: Final = "STL, OBJ, PLY, OFF, 3MF, STEP, CSG text (.csg.yaml)"


def load_solid(path: Path, *, unit: str | None = None, on_stage: OnStage = no_stage) -> Solid:
    """Return the solid of a CAD file, proven to be one closed solid.

    Parameters
    ----------
    path : STL, OBJ, PLY, OFF, 3MF, STEP or CSG text; ``file.step#NAME`` is one body of several
    unit : unit of the file's lengths: mm, cm, m or inch. None: what the file says or, where its
        format has no place for it (STL, OBJ, PLY, OFF), millimetres, if these make a part of sense
    on_stage : callback, called with the name of each stage as it begins

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
        source.part_name,
        content_hash,
        where=str(path),
        unit=found or name,
        unit_is_declared=found is not None or unit is not None,
        on_stage=on_stage,
    )


def _read_merged(path: Path, ending: str, unit: str | None) -> tuple[Merged, str, str | None]:
    """Return a file's triangles in mm, its SHA-256, and the unit it names, if it names one.

    The corners as read, three for each triangle, are released before anything is computed.
    """
    data, stated = read_file(path), None
    _, mm_per_unit = read_unit(unit or "mm", path)
    if ending == ".3mf":
        vertices, triangles, spelling = read_3mf(data, path)
        stated, mm_per_unit = read_unit(spelling, path)
        check_unit(unit, stated, path)
    else:
        vertices, triangles = TRIANGLE_READERS[ending](data, path)
    content_hash = hashlib.sha256(data).hexdigest()
    del data
    if mm_per_unit != 1.0:
        with np.errstate(over="ignore"):
            vertices = vertices * mm_per_unit
    is_declared = unit is not None or stated is not None
    merged = merge_corners(vertices, triangles, str(path), unit_is_declared=is_declared)
    return merged, content_hash, stated
