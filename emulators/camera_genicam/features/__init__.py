"""The features of the camera: one table, of which registers and description are made."""

from .description import describe
from .table import (
    DESCRIPTION_ADDRESS,
    Feature,
    Kind,
    PixelFormat,
    Sensor,
    features_of,
)

__all__ = [
    "DESCRIPTION_ADDRESS",
    "Feature",
    "Kind",
    "PixelFormat",
    "Sensor",
    "describe",
    "features_of",
]
