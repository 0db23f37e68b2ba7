"""Pose of a held part: one for each grasp, from the outlines of all its views together.

What a part's size or form is off by stays in the residuals: a pose has six freedoms, faces have
their own, small ones, and neither scale nor thickness is among them.
"""

from ._backlit import Backlit, backlit_outline, chord_px
from ._joint import fit_grasp
from ._rims import Rims, find_rims
from ._types import FaceShift, GraspPose, OutlineView, PoseSettings, ViewPose
from .rivals import Rival, find_rival, is_suspect, mirror_image

__all__ = [
    "Backlit",
    "FaceShift",
    "GraspPose",
    "OutlineView",
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
]
