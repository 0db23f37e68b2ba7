"""Limits of a value: general tolerances, fits."""

from .general import (
    TOLERANCE_CLASSES,
    ToleranceClass,
    angle_tolerance_rad,
    linear_tolerance_mm,
    radius_tolerance_mm,
)

__all__ = [
    "TOLERANCE_CLASSES",
    "ToleranceClass",
    "angle_tolerance_rad",
    "linear_tolerance_mm",
    "radius_tolerance_mm",
]
