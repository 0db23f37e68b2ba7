"""Pictures under lamps against bounds of the light: coverage, and differences."""

from .compare import BURNT_GREY
from .marks import DISC, FILTER_STEP, LINE_NODES, LINE_WIDTH, SPOT_NODES
from .pictures import MIN_WIDTH_PX, STEP_PX, LitPictures

__all__ = [
    "BURNT_GREY",
    "DISC",
    "FILTER_STEP",
    "LINE_NODES",
    "LINE_WIDTH",
    "MIN_WIDTH_PX",
    "SPOT_NODES",
    "STEP_PX",
    "LitPictures",
]
