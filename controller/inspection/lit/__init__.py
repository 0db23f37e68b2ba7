"""Pictures under lamps against bounds of the light: where they were compared, where they differ."""

from .compare import BURNT_GREY
from .pictures import LEAST_WIDTH_PX, LitPictures

__all__ = ["BURNT_GREY", "LEAST_WIDTH_PX", "LitPictures"]
