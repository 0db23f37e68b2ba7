"""The boundary of a solid: its surfaces, and the edges between them."""

from ._segment import find_faces
from ._types import Boundary, Crease, Curve, Face, FaceKind

__all__ = ["Boundary", "Crease", "Curve", "Face", "FaceKind", "find_faces"]
