"""The trials of a verification with the plate: a hand-off there and back, and its known lengths."""

from .hand_off import ProvenHandOff, hand_off_and_back
from .lengths import LengthStudy, length_study
from .recipes import ReachedPose, RecipeReach, check_reach

__all__ = [
    "LengthStudy",
    "ProvenHandOff",
    "ReachedPose",
    "RecipeReach",
    "check_reach",
    "hand_off_and_back",
    "length_study",
]
