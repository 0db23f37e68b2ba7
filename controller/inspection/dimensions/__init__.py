"""Dimensions: where edges must show, where they are, and with what uncertainty."""

from ._looks import Estimate
from ._types import BACKLIT, MeasuringSettings, PosedView
from .combine import Combined, combine
from .measuring import look, measure

__all__ = [
    "BACKLIT",
    "Combined",
    "Estimate",
    "MeasuringSettings",
    "PosedView",
    "combine",
    "look",
    "measure",
]
