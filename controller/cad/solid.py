"""A part's CAD file as a solid: closed, one body, in millimetres, its surfaces named."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from controller.arrays import BoolArray, FloatArray, Int32Array, IntArray
from controller.memory import give_back
from messages import key

from .boundary import Boundary, Face, find_boundary, search_faces
from .errors import CoordinatesCadError, EmptyCadError, LargeCadError, UnitCadError
from .large import ADJACENCY, AT_ONCE, drop_derived
from .soundness import check_soundness
from .stages import OnStage, no_stage
from .welding import weld

MM_PER_INCH = 25.4
MM_PER_M = 1000.0
SMALLEST_MM = 1.0  # longest side below which no jaw can hold a part
SENSIBLE_MM = (10.0, 2000.0)  # longest side of a part whose file names no unit
FARTHEST_MM = 1e5  # single precision there is 0.01 mm, as coarse as what is inspected
SENSELESS_MM = 1e7  # size that no unit explains
MAX_TRIANGLES = 2_000_000
HULL_OPTIONS = "QbB Pp Qt"  # scaled to a cube, without warnings, in triangles


@dataclass(frozen=True, eq=False)
class Solid:
    """A part from its CAD file, in the CAD frame [mm].

    Attributes
    ----------
    name : the file's stem
    mesh : closed triangle mesh, outward normals
    content_hash : SHA-256 of the file
    volume_mm3, centroid_mm : volume and its centroid (3,)
    faces, face_of_triangle : surfaces, and the surface each triangle belongs to (n,)
    unit : length unit of the file; all lengths here are in mm
    unit_is_declared : False where millimetres are no more than the usual
    density_g_cm3 : density stated in the file
    faces_are_complete : False where the search for surfaces ended before it was done, so that some
        with a formula may be among the free-form ones
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
    faces_are_complete: bool = True

    @cached_property
    def boundary(self) -> Boundary:
        """Edges, loops and vertices between the surfaces, computed on first use.

        A compiled part puts its stored one in place with ``vars(solid)["boundary"] = stored``.
        """
        return find_boundary(self.mesh, self.faces, self.face_of_triangle)

    @cached_property
    def hull_mm(self) -> FloatArray:
        """Corners of the convex hull (k, 3), in the order of the mesh's, computed on first use.

        A compiled part sets its stored corners here, and likewise its boundary.
        """
        vertices = np.asarray(self.mesh.vertices, dtype=np.float64)
        corners = vertices[np.sort(ConvexHull(vertices, qhull_options=HULL_OPTIONS).vertices)]
        if len(vertices) > AT_ONCE:
            give_back()
        return corners


@dataclass(frozen=True, eq=False, slots=True)
class Merged:
    """Triangles with merged corners, and the number of each in the file.

    Attributes
    ----------
    vertices_mm, triangles : (v, 3) and (n, 3)
    kept : (n,) number of each one in the file, or of the one in whose surface it lies
    """

    vertices_mm: FloatArray
    triangles: IntArray
    kept: IntArray


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
    name : name of the part
    content_hash : content hash of the file it came from
    where : its origin, for messages
    faces, face_of_triangle : the surfaces as the file itself names them (STEP), and the one each
        triangle (n,) is of; given together. None: they are found in the mesh
    unit : length unit of the file, for the record
    unit_is_declared : False: the size must make sense in mm
    density_g_cm3 : None where nobody has named it

    Raises
    ------
    EmptyCadError, LargeCadError, CoordinatesCadError, UnitCadError : before anything is computed
    OpenCadError, InsideOutCadError, ManySolidsCadError, SelfIntersectingCadError : no sound solid
    """
    merged = merge_corners(
        np.asarray(mesh.vertices, dtype=np.float64),
        np.asarray(mesh.faces, dtype=np.int64),
        where,
        unit_is_declared=unit_is_declared,
    )
    return solid_of(
        merged,
        name,
        content_hash,
        where,
        faces=faces,
        face_of_triangle=face_of_triangle,
        unit=unit,
        unit_is_declared=unit_is_declared,
        density_g_cm3=density_g_cm3,
    )


def merge_corners(
    vertices_mm: FloatArray, triangles: IntArray, where: str, *, unit_is_declared: bool = True
) -> Merged:
    """Return checked triangles, with the corners at one position merged.

    Parameters
    ----------
    vertices_mm, triangles : (v, 3) and (n, 3)
    where : their origin, for messages
    unit_is_declared : False: the size must make sense in mm

    Raises
    ------
    EmptyCadError, LargeCadError, CoordinatesCadError, UnitCadError : as in `make_solid`
    """
    if len(triangles) == 0:
        raise EmptyCadError(f"{where}: holds no triangles; export the solid body, not a sketch")
    check_count(len(triangles), where)
    if not 0 <= triangles.min() <= triangles.max() < len(vertices_mm):
        raise CoordinatesCadError(
            f"{where}: triangles name corners the file does not hold; export it again"
        )
    is_used = np.zeros(len(vertices_mm), dtype=bool)
    is_used[triangles] = True
    _check_size(vertices_mm, is_used, where, unit_is_declared)
    merged = Merged(*weld(vertices_mm, triangles))
    if len(merged.triangles) == 0:
        raise EmptyCadError(f"{where}: no triangle has any area; export the solid body again")
    return merged


def solid_of(
    merged: Merged,
    name: str,
    content_hash: str,
    where: str,
    *,
    faces: tuple[Face, ...] | None = None,
    face_of_triangle: Int32Array | None = None,
    unit: str = "mm",
    unit_is_declared: bool = True,
    density_g_cm3: float | None = None,
    on_stage: OnStage = no_stage,
) -> Solid:
    """Return a checked solid of merged triangles.

    Parameters
    ----------
    merged : as `merge_corners` has it
    name, content_hash, where, faces, face_of_triangle, unit, unit_is_declared, density_g_cm3 : as
        in `make_solid`
    on_stage : callback, called with the name of each stage as it begins

    Raises
    ------
    OpenCadError, InsideOutCadError, ManySolidsCadError, SelfIntersectingCadError : no sound solid
    """
    mesh = trimesh.Trimesh(merged.vertices_mm, merged.triangles, process=False)
    on_stage(key("checking that the mesh is one solid"))
    check_soundness(mesh, where)
    is_complete = True
    if faces is None or face_of_triangle is None:
        on_stage(key("finding surfaces"))
        found = search_faces(mesh)
        faces, face_of_triangle = found.faces, found.face_of_triangle
        is_complete = found.is_complete
    else:
        face_of_triangle = face_of_triangle[merged.kept]
    drop_derived(mesh, *ADJACENCY)
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
        faces_are_complete=is_complete,
    )


def check_count(triangle_count: int, where: str) -> None:
    """Refuse too many triangles, if possible before they are read.

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
    if not is_used.all():
        vertices_mm = vertices_mm[is_used]
    low, high = vertices_mm.min(axis=0), vertices_mm.max(axis=0)
    farthest = float(max(-low.min(), high.max()))
    if farthest > SENSELESS_MM:
        raise CoordinatesCadError(
            f"{where}: holds a coordinate of {farthest:.3g} mm, which is beyond sense; "
            "export it again, or declare its unit"
        )
    size_mm = high - low
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
