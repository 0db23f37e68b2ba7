"""The boundary of a solid: its surfaces, and the edges between them."""

from ._checks import check_boundary, euler_defect, face_genera
from ._dcel import find_boundary
from ._normals import surface_normals
from ._segment import find_faces
from ._types import Boundary, Crease, Curve, Face, FaceKind

__all__ = [
    "Boundary",
    "Crease",
    "Curve",
    "Face",
    "FaceKind",
    "check_boundary",
    "euler_defect",
    "face_genera",
    "find_boundary",
    "find_faces",
    "surface_normals",
]
