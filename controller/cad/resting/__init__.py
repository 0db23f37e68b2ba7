"""The ways a solid can lie on a table, and how likely each is."""

from ._families import RollingFamily
from ._odds import PoseOdds, pose_odds
from ._poses import Resting, StablePose, find_resting, stable_poses

__all__ = [
    "PoseOdds",
    "Resting",
    "RollingFamily",
    "StablePose",
    "find_resting",
    "pose_odds",
    "stable_poses",
]
