"""Where the edges of a part show, whether they are in place, and what that proves of its faces."""

from ._edges import find_edges
from ._faces import FaceEdges, inner_mm
from ._recesses import Recess, find_recesses
from .evidence import EdgeEvidence, EdgeView, find_evidence

__all__ = [
    "EdgeEvidence",
    "EdgeView",
    "FaceEdges",
    "Recess",
    "find_edges",
    "find_evidence",
    "find_recesses",
    "inner_mm",
]
