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

from controller.config import CAD_FORMATS, split_cad
from controller.config.cad_files import MARK, STEP_FORMATS

from ..errors import UnreadableCadError
from ..solid import Solid, make_solid
from ._ahead import check_ahead, read_file, size_of
from ._threemf import check_3mf
from .csg import read_csg
from .units import check_unit, read_unit

# what trimesh stumbles over is told once, by our errors, and not on the terminal besides
logging.getLogger("trimesh").addHandler(logging.NullHandler())

FORMAT_NAMES: Final = "STL, OBJ, PLY, OFF, 3MF, STEP, CSG text (.csg.yaml)"


def load_solid(path: Path, *, unit: str | None = None) -> Solid:
    """Return the solid of a CAD file, proven to be one closed solid.

    Parameters
    ----------
    path : STL, OBJ, PLY, OFF, 3MF, STEP or CSG text; ``file.step#NAME`` is one body of several
    unit : of the file's lengths: mm, cm, m or inch. None: what the file says or, where its format
        has no place for it (STL, OBJ, PLY, OFF), millimetres, if these make a part of sense

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
    name, mm_per_unit = read_unit(unit or "mm", path)
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
    data = read_file(path)
    is_declared = unit is not None
    if ending == ".3mf":
        stated = check_3mf(data, path)
        check_unit(unit, stated, path)
        (name, mm_per_unit), is_declared = read_unit(stated, path), True
    mesh = _read_mesh(data, path, ending)
    with np.errstate(over="ignore"):
        mesh.vertices = np.asarray(mesh.vertices) * mm_per_unit
    return make_solid(
        mesh,
        path.stem,
        hashlib.sha256(data).hexdigest(),
        where=str(path),
        unit=name,
        unit_is_declared=is_declared,
    )


def _read_mesh(data: bytes, path: Path, ending: str) -> trimesh.Trimesh:
    """Return the triangles in the file's unit.

    A stream has no folder, so that no file beside it (a texture, a material) is read unasked.
    """
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns where a text breaks off, and goes on
            # unprocessed: trimesh would drop triangles with broken coordinates without a word
            loaded = trimesh.load(
                io.BytesIO(data), file_type=ending[1:], force="mesh", process=False
            )
        mesh = cast("trimesh.Trimesh", loaded)  # forced to be one
        faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices)
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
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(mesh.vertices):
        raise UnreadableCadError(
            f"{path}: a triangle names corner {int(faces.max())} of {len(mesh.vertices)}; "
            "export it again"
        )
    return mesh
