"""Pictures under lamps against bounds of the light: where they were compared, where they differ."""

from .compare import BURNT_GREY
from .pictures import MIN_WIDTH_PX, LitPictures

__all__ = ["BURNT_GREY", "MIN_WIDTH_PX", "LitPictures"]
