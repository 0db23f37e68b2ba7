"""Comparison of pictures under lamps with bounds on the light: coverage and differences."""

from .compare import BURNT_GREY
from .finish import Finish, Polish, finish_of
from .learned import (
    COARSE,
    Appearance,
    LearnedPicture,
    LearnedView,
    contrast,
    on_grid,
    pose_gap,
    regridded,
)
from .marks import (
    DISC,
    FILTER_COUNT,
    FILTER_STEP,
    LINE_NODES,
    LINE_WIDTH,
    SPOT_NODES,
    filtered,
    unusual,
)
from .pictures import DISC_OFF, MIN_WIDTH_PX, STEP_PX, LitPictures

__all__ = [
    "BURNT_GREY",
    "COARSE",
    "DISC",
    "DISC_OFF",
    "FILTER_COUNT",
    "FILTER_STEP",
    "LINE_NODES",
    "LINE_WIDTH",
    "MIN_WIDTH_PX",
    "SPOT_NODES",
    "STEP_PX",
    "Appearance",
    "Finish",
    "LearnedPicture",
    "LearnedView",
    "LitPictures",
    "Polish",
    "contrast",
    "filtered",
    "finish_of",
    "on_grid",
    "pose_gap",
    "regridded",
    "unusual",
]
