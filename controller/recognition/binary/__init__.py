"""Outlines of silhouettes: their corners, and the stretches that bend most.

The paper's chain of codes and strings (references.md P3.1) became these two: docs/paper.md.
"""

from ._corners import (
    CornerTolerances,
    NoOutlineError,
    OutlineCorners,
    find_peaks,
    outline_corners,
    triangular,
)
from ._stretches import STRETCHES_MM, StretchIndex, like, observed_stretches, stretch_index

__all__ = [
    "STRETCHES_MM",
    "CornerTolerances",
    "NoOutlineError",
    "OutlineCorners",
    "StretchIndex",
    "find_peaks",
    "like",
    "observed_stretches",
    "outline_corners",
    "stretch_index",
    "triangular",
]
