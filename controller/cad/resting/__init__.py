"""The ways a solid can lie on a table, and how likely each is."""

from ._poses import StablePose, stable_poses

__all__ = ["StablePose", "stable_poses"]
