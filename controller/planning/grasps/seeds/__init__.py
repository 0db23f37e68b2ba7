"""Grasp candidates on a part: opposed walls, seeds between them, candidates round each."""

from ._candidates import (
    GraspCandidates,
    approach_seems_free,
    axis_distance,
    candidates,
    open_gap,
    pre_open,
)
from ._faces import FacePair, across, opposed_faces
from ._from_above import from_above
from ._seeds import Seeds, find_seeds, narrowest_inner, needed_friction, widest_inner

__all__ = [
    "FacePair",
    "GraspCandidates",
    "Seeds",
    "across",
    "approach_seems_free",
    "axis_distance",
    "candidates",
    "find_seeds",
    "from_above",
    "narrowest_inner",
    "needed_friction",
    "open_gap",
    "opposed_faces",
    "pre_open",
    "widest_inner",
]
