"""Dimensions: predicted edges, measured edges, and their uncertainty."""

from ._curves import Curve
from ._foreseen import is_explained
from ._looks import Estimate, features_of
from ._pictures import predict
from ._rays import Rays, place_rays, with_rotation, with_visibility
from ._types import BACKLIT, MeasuringSettings, PosedView
from .combine import Combined, combine
from .measuring import look, measure, measure_ahead, result_of

__all__ = [
    "BACKLIT",
    "Combined",
    "Curve",
    "Estimate",
    "MeasuringSettings",
    "PosedView",
    "Rays",
    "combine",
    "features_of",
    "is_explained",
    "look",
    "measure",
    "measure_ahead",
    "place_rays",
    "predict",
    "result_of",
    "with_rotation",
    "with_visibility",
]
