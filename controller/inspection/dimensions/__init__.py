"""Dimensions: predicted edges, measured edges, and their uncertainty."""

from ._curves import Curve
from ._foreseen import is_explained, shadow_shifts_px
from ._looks import Estimate, Sought, features_of
from ._pictures import Prediction, predict
from ._rays import Rays, place_rays, with_rotation, with_visibility
from ._types import BACKLIT, MeasuringSettings, PosedView
from .combine import Combined, combine
from .measuring import (
    DimensionLooks,
    look,
    look_for,
    measure,
    put_together,
    result_of,
    seek_all,
)

__all__ = [
    "BACKLIT",
    "Combined",
    "Curve",
    "DimensionLooks",
    "Estimate",
    "MeasuringSettings",
    "PosedView",
    "Prediction",
    "Rays",
    "Sought",
    "combine",
    "features_of",
    "is_explained",
    "look",
    "look_for",
    "measure",
    "place_rays",
    "predict",
    "put_together",
    "result_of",
    "seek_all",
    "shadow_shifts_px",
    "with_rotation",
    "with_visibility",
]
