"""Outlines of silhouettes: their corners, and the stretches that bend most.

The paper's chain of codes and strings (references.md P3.1) became these two: docs/paper.md.
"""

from ._corners import find_corners, triangular
from ._outline import NoOutlineError, OutlineCorners, outline_corners
from ._stretches import STRETCHES_MM, StretchIndex, like, observed_stretches, stretch_index
from ._tolerances import BinaryTolerances

__all__ = [
    "STRETCHES_MM",
    "BinaryTolerances",
    "NoOutlineError",
    "OutlineCorners",
    "StretchIndex",
    "find_corners",
    "like",
    "observed_stretches",
    "outline_corners",
    "stretch_index",
    "triangular",
]
