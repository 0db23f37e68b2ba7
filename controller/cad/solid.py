"""A part's CAD file as a solid: closed, one body, in millimetres, its surfaces named."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray, Int32Array

from .boundary import Boundary, Face, find_boundary, find_faces
from .errors import CoordinatesCadError, EmptyCadError, LargeCadError, UnitCadError
from .soundness import check_soundness
from .welding import weld

MM_PER_INCH = 25.4
MM_PER_M = 1000.0
SMALLEST_MM = 1.0  # below this no jaw holds it
SENSIBLE_MM = (10.0, 2000.0)  # longest side of a part whose file names no unit
FARTHEST_MM = 1e5  # single precision there is 0.01 mm, as coarse as what is inspected
SENSELESS_MM = 1e7  # no unit makes a part of this
MAX_TRIANGLES = 2_000_000


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
    unit : what the file's lengths were in; all here are in mm
    unit_is_declared : False where millimetres are no more than the usual
    density_g_cm3 : where the file says it
    """

    name: str
    mesh: trimesh.Trimesh
    content_hash: str
    volume_mm3: float
    centroid_mm: FloatArray
    faces: tuple[Face, ...]
    face_of_triangle: Int32Array
    unit: str = "mm"
    unit_is_declared: bool = True
    density_g_cm3: float | None = None

    @cached_property
    def boundary(self) -> Boundary:
        """Edges, loops and vertices between the surfaces, found when first asked for.

        A compiled part puts its stored one in place with ``vars(solid)["boundary"] = stored``.
        """
        return find_boundary(self.mesh, self.faces, self.face_of_triangle)


def make_solid(
    mesh: trimesh.Trimesh,
    name: str,
    content_hash: str,
    where: str,
    *,
    faces: tuple[Face, ...] | None = None,
    face_of_triangle: Int32Array | None = None,
    unit: str = "mm",
    unit_is_declared: bool = True,
    density_g_cm3: float | None = None,
) -> Solid:
    """Return a checked solid of a mesh.

    Parameters
    ----------
    mesh : in mm, CAD frame; corners at one position may be listed more than once
    name : of the part
    content_hash : of the file it came from
    where : its origin, for messages
    faces, face_of_triangle : the surfaces as the file itself names them (STEP), and the one each
        triangle (n,) is of; given together. None: they are found in the mesh
    unit : what the file was in, for the record
    unit_is_declared : False: the size must make sense in mm
    density_g_cm3 : None where nobody has named it

    Raises
    ------
    EmptyCadError, LargeCadError, CoordinatesCadError, UnitCadError : before anything is computed
    OpenCadError, InsideOutCadError, ManySolidsCadError, SelfIntersectingCadError : no sound solid
    """
    if len(mesh.faces) == 0:
        raise EmptyCadError(f"{where}: holds no triangles; export the solid body, not a sketch")
    check_count(len(mesh.faces), where)
    vertices_mm = np.asarray(mesh.vertices, dtype=np.float64)
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    if not 0 <= triangles.min() <= triangles.max() < len(vertices_mm):
        raise CoordinatesCadError(
            f"{where}: triangles name corners the file does not hold; export it again"
        )
    is_used = np.zeros(len(vertices_mm), dtype=bool)
    is_used[triangles] = True
    _check_size(vertices_mm, is_used, where, unit_is_declared)
    vertices_mm, triangles, kept = weld(vertices_mm, triangles)
    if len(triangles) == 0:
        raise EmptyCadError(f"{where}: no triangle has any area; export the solid body again")
    mesh = trimesh.Trimesh(vertices_mm, triangles, process=False)
    check_soundness(mesh, where)
    if faces is None or face_of_triangle is None:
        faces, face_of_triangle = find_faces(mesh)
    else:
        face_of_triangle = face_of_triangle[kept]
    return Solid(
        name=name,
        mesh=mesh,
        content_hash=content_hash,
        volume_mm3=float(mesh.volume),
        centroid_mm=np.asarray(mesh.center_mass, dtype=np.float64),
        faces=faces,
        face_of_triangle=face_of_triangle,
        unit=unit,
        unit_is_declared=unit_is_declared,
        density_g_cm3=density_g_cm3,
    )


def check_count(triangle_count: int, where: str) -> None:
    """Refuse more triangles than a part is worth, at best before they are read.

    Raises
    ------
    LargeCadError : more than `MAX_TRIANGLES`
    """
    if triangle_count > MAX_TRIANGLES:
        raise LargeCadError(
            f"{where}: {triangle_count:,} triangles, the most is {MAX_TRIANGLES:,}; "
            "export it with a coarser chord error"
        )


def _check_size(
    vertices_mm: FloatArray, is_used: BoolArray, where: str, unit_is_declared: bool
) -> None:
    if not np.isfinite(vertices_mm).all():
        raise CoordinatesCadError(
            f"{where}: holds coordinates that are no numbers; export it again"
        )
    vertices_mm = vertices_mm[is_used]
    farthest = float(np.abs(vertices_mm).max())
    if farthest > SENSELESS_MM:
        raise CoordinatesCadError(
            f"{where}: holds a coordinate of {farthest:.3g} mm, which is beyond sense; "
            "export it again, or declare its unit"
        )
    size_mm = np.ptp(vertices_mm, axis=0)
    longest = float(size_mm.max())
    across = " x ".join(f"{edge:.4g}" for edge in size_mm)
    smallest, largest = SENSIBLE_MM
    if not unit_is_declared and not smallest <= longest <= largest:
        inches = " x ".join(f"{edge * MM_PER_INCH:.4g}" for edge in size_mm)
        metres = " x ".join(f"{edge * MM_PER_M:.4g}" for edge in size_mm)
        raise UnitCadError(
            f"{where}: names no unit, and would be {across} mm in millimetres, {inches} mm if "
            f"these were inches, {metres} mm if they were metres; declare which with --unit, "
            "or in a recipe with unit:"
        )
    if longest < SMALLEST_MM:
        raise UnitCadError(
            f"{where}: is {across} mm, below {SMALLEST_MM:g} mm no jaw holds it; "
            "is its unit declared right?"
        )
    if farthest > FARTHEST_MM:
        raise CoordinatesCadError(
            f"{where}: reaches {farthest / MM_PER_M:.0f} m from its origin, too far for its "
            "digits; move it to the origin and export it again"
        )
