"""A part's CAD file as a solid: closed, one body, in millimetres, its surfaces named."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from ._faces import Face, find_faces
from .errors import (
    EmptyCadError,
    ManySolidsCadError,
    OpenCadError,
    UnreadableCadError,
)

Array = NDArray[np.float64]

FORMATS = (".stl", ".obj", ".ply", ".off")
MERGE_DIGITS = 4  # corners within 1e-4 mm are one: STL repeats each corner per triangle
SMALLEST_MM = 1.0  # below this no jaw holds it; a part in metres ends here too
STL_HEADER_BYTES = 84  # 80 of text, then the count of triangles
STL_TRIANGLE_BYTES = 50


@dataclass(frozen=True, eq=False)
class Solid:
    """A part as its CAD file describes it, in the CAD frame [mm].

    Attributes
    ----------
    name : the file's stem
    mesh : closed triangle mesh, outward normals
    content_hash : SHA-256 of the file
    volume_mm3, centroid_mm : volume and its centroid (3,)
    faces, face_of_triangle : surfaces, and the surface each triangle belongs to (n,)
    """

    name: str
    mesh: trimesh.Trimesh
    content_hash: str
    volume_mm3: float
    centroid_mm: Array
    faces: tuple[Face, ...]
    face_of_triangle: NDArray[np.int32]


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


def make_solid(mesh: trimesh.Trimesh, name: str, content_hash: str, where: str) -> Solid:
    """Return a checked solid of a mesh [mm]; ``where`` names its origin in messages.

    Raises
    ------
    EmptyCadError, OpenCadError, ManySolidsCadError, UnreadableCadError : as `load_solid`
    """
    if len(mesh.faces) == 0:
        raise EmptyCadError(f"{where}: holds no triangles; export the solid body, not a sketch")
    if not np.isfinite(mesh.vertices).all():
        raise UnreadableCadError(f"{where}: holds coordinates that are no numbers; export it again")
    size_mm = np.asarray(mesh.extents)
    if size_mm.max() < SMALLEST_MM:
        across = " x ".join(f"{edge:.4g}" for edge in size_mm)
        raise UnreadableCadError(
            f"{where}: is {across} mm; were these metres or inches? export it in millimetres"
        )
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=MERGE_DIGITS)
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-9))
    mesh.remove_unreferenced_vertices()
    if not mesh.is_watertight:
        broken = len(mesh.faces) * 3 - 2 * len(mesh.face_adjacency)
        raise OpenCadError(
            f"{where}: the surface is not closed ({broken} open triangle sides); "
            "repair it in the CAD system and export it again"
        )
    if not mesh.is_winding_consistent:
        raise OpenCadError(
            f"{where}: some triangles face inwards, others outwards; "
            "repair it in the CAD system and export it again"
        )
    if mesh.volume <= 0:
        raise OpenCadError(
            f"{where}: the surface is turned inside out (volume "
            f"{mesh.volume:.1f} mm3); flip its normals and export it again"
        )
    if mesh.body_count != 1:
        raise ManySolidsCadError(
            f"{where}: holds {mesh.body_count} separate bodies, one part "
            "is one body; export them one by one"
        )
    faces, face_of_triangle = find_faces(mesh)
    return Solid(
        name=name,
        mesh=mesh,
        content_hash=content_hash,
        volume_mm3=float(mesh.volume),
        centroid_mm=np.asarray(mesh.center_mass, dtype=np.float64),
        faces=faces,
        face_of_triangle=face_of_triangle,
    )
