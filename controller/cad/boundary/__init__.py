"""The boundary of a solid: its surfaces, and the edges between them."""

from ._normals import surface_normals
from ._types import HALF_TURN_RAD, Boundary, Crease, Curve, Face, FaceKind, turn_of
from .edges.checks import check_boundary, euler_defect, face_genera
from .edges.dcel import find_boundary
from .faces.segment import FaceSearch, find_faces, search_faces

__all__ = [
    "HALF_TURN_RAD",
    "Boundary",
    "Crease",
    "Curve",
    "Face",
    "FaceKind",
    "FaceSearch",
    "check_boundary",
    "euler_defect",
    "face_genera",
    "find_boundary",
    "find_faces",
    "search_faces",
    "surface_normals",
    "turn_of",
]
