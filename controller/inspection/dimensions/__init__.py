"""Dimensions: predicted edges, measured edges, and their uncertainty."""

from ._curves import Curve
from ._foreseen import is_explained
from ._looks import Estimate, Sought, features_of
from ._pictures import predict
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
    "with_rotation",
    "with_visibility",
]
