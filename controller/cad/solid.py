"""A part's CAD file as a solid: closed, one body, in millimetres, its surfaces named."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from numpy.typing import NDArray

from .boundary import Boundary, Face, find_boundary, find_faces
from .errors import (
    EmptyCadError,
    ManySolidsCadError,
    OpenCadError,
    UnreadableCadError,
)

Array = NDArray[np.float64]

MERGE_DIGITS = 4  # corners within 1e-4 mm are one: STL repeats each corner per triangle
SMALLEST_MM = 1.0  # below this no jaw holds it; a part in metres ends here too


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
    face_of_triangle: NDArray[np.int32] | None = None,
) -> Solid:
    """Return a checked solid of a mesh [mm]; ``where`` names its origin in messages.

    Where the file itself names its surfaces, as STEP does, they come as ``faces`` and
    ``face_of_triangle`` (n,), given together; otherwise they are found in the mesh.

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
    is_sound = mesh.nondegenerate_faces(height=1e-9)
    mesh.update_faces(is_sound)
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
    if faces is None or face_of_triangle is None:
        faces, face_of_triangle = find_faces(mesh)
    else:
        face_of_triangle = face_of_triangle[is_sound]
    return Solid(
        name=name,
        mesh=mesh,
        content_hash=content_hash,
        volume_mm3=float(mesh.volume),
        centroid_mm=np.asarray(mesh.center_mass, dtype=np.float64),
        faces=faces,
        face_of_triangle=face_of_triangle,
    )
