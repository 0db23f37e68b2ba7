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

FORMATS = (".stl", ".obj", ".ply", ".3mf", ".off")
MERGE_MM = 1e-4  # corners closer than this are one: STL repeats each corner per triangle


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
    path : STL, OBJ, PLY, 3MF or OFF, lengths in mm

    Raises
    ------
    UnreadableCadError : missing, unknown format, or damaged
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
    try:
        mesh = trimesh.load(path, force="mesh", process=True)
    except Exception as error:
        raise UnreadableCadError(
            f"{path}: cannot be read as {path.suffix[1:].upper()} "
            f"({type(error).__name__}: {error}); export it again"
        ) from error
    return make_solid(mesh, path.stem, hashlib.sha256(data).hexdigest(), where=str(path))


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
    mesh.merge_vertices(digits_vertex=4)
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-9))
    if not mesh.is_watertight:
        broken = len(mesh.faces) * 3 - 2 * len(mesh.face_adjacency)
        raise OpenCadError(
            f"{where}: the surface is not closed ({broken} open triangle sides); "
            "repair it in the CAD system and export it again"
        )
    if not mesh.is_winding_consistent or mesh.volume <= 0:
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
