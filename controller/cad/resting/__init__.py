"""The stable poses of a solid on a table, their probabilities, and look-alikes."""

from ._alike import MAX_COMPARED, AlikeSearch, LookAlike, look_alikes, search_look_alikes
from ._families import RollingFamily
from ._poses import Resting, StablePose, find_resting, stable_poses
from ._symmetry import PartSymmetry, name_duplicates, part_symmetries

__all__ = [
    "MAX_COMPARED",
    "AlikeSearch",
    "LookAlike",
    "PartSymmetry",
    "Resting",
    "RollingFamily",
    "StablePose",
    "find_resting",
    "look_alikes",
    "name_duplicates",
    "part_symmetries",
    "search_look_alikes",
    "stable_poses",
]
