"""Triangle files of the usual kinds, read whole or refused."""

import hashlib
from pathlib import Path

import numpy as np
import trimesh

from ..errors import EmptyCadError, UnreadableCadError
from ..solid import Solid, make_solid

FORMATS = (".stl", ".obj", ".ply", ".off")
STL_HEADER_BYTES = 84  # 80 of text, then the count of triangles
STL_TRIANGLE_BYTES = 50


def load_solid(path: Path) -> Solid:
    """Read a CAD file and prove that it is one closed solid.

    Parameters
    ----------
    path : STL, OBJ, PLY or OFF, lengths in mm

    Raises
    ------
    UnreadableCadError : missing, unknown format, damaged, or not in millimetres
    EmptyCadError : no triangles
    OpenCadError : does not enclose a volume
    ManySolidsCadError : more than one body
    """
    if path.suffix.lower() not in FORMATS:
        known = ", ".join(f[1:].upper() for f in FORMATS)
        raise UnreadableCadError(
            f"{path}: format {path.suffix or 'without ending'} is not read; "
            f"export the part as one of {known}"
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UnreadableCadError(f"{path}: {error.strerror or error}; check the path") from error
    if not data.strip():
        raise EmptyCadError(f"{path}: the file is empty; export the part again")
    if path.suffix.lower() == ".stl":
        _check_stl(data, path)
    elif path.suffix.lower() in {".obj", ".off"}:
        _check_text(data, path)
    try:
        # unprocessed: trimesh would drop triangles with broken coordinates without a word
        with np.errstate(all="ignore"):
            mesh = trimesh.load(path, force="mesh", process=False)
    except Exception as error:
        raise UnreadableCadError(
            f"{path}: cannot be read as {path.suffix[1:].upper()} "
            f"({type(error).__name__}: {error}); export it again"
        ) from error
    return make_solid(mesh, path.stem, hashlib.sha256(data).hexdigest(), where=str(path))


def _check_stl(data: bytes, path: Path) -> None:
    """Raise UnreadableCadError where an STL is cut short or none, which trimesh may not notice."""
    promised = int.from_bytes(data[80:STL_HEADER_BYTES], "little")
    if len(data) == STL_HEADER_BYTES + STL_TRIANGLE_BYTES * promised:
        return  # first, since binary files too may begin with "solid"
    if data.lstrip()[:5].lower() == b"solid":
        _check_text(data, path)
        if b"endsolid" not in data.lower():
            raise UnreadableCadError(f"{path}: the text breaks off; copy or export it again")
    elif b"\0" not in data or len(data) < STL_HEADER_BYTES:
        raise UnreadableCadError(f"{path}: is no STL, whatever its name says; export it again")
    else:
        held = (len(data) - STL_HEADER_BYTES) / STL_TRIANGLE_BYTES
        raise UnreadableCadError(
            f"{path}: promises {promised} triangles and holds {held:.1f}; copy or export it again"
        )


def _check_text(data: bytes, path: Path) -> None:
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UnreadableCadError(
            f"{path}: byte {error.start} is no text (UTF-8); is it the right file? export it again"
        ) from error
