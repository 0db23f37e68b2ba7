"""Pose of a held part: one per grasp, from the outlines of all its views together.

Deviations of a part's size or form remain in the residuals: a pose has six degrees of freedom, and
faces have small ones of their own, but neither includes scale or thickness.
"""

from ._backlit import Backlit, backlit_outline, chord_px
from ._joint import fit_grasp
from ._rims import Rims, find_rims
from ._turned import settle_turn
from ._types import FaceShift, GraspPose, OutlinedView, PoseSettings, ViewPose
from .rivals import Rival, find_rival, is_suspect, mirror_image

__all__ = [
    "Backlit",
    "FaceShift",
    "GraspPose",
    "OutlinedView",
    "PoseSettings",
    "Rims",
    "Rival",
    "ViewPose",
    "backlit_outline",
    "chord_px",
    "find_rims",
    "find_rival",
    "fit_grasp",
    "is_suspect",
    "mirror_image",
    "settle_turn",
]
