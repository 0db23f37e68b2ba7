"""Limits of a value: general tolerances, fits."""

from .decision import CONFORMANCE_PROBABILITY, COVERAGE_FACTOR, decide
from .general import (
    TOLERANCE_CLASSES,
    ToleranceClass,
    angle_tolerance_rad,
    linear_tolerance_mm,
    radius_tolerance_mm,
)

__all__ = [
    "CONFORMANCE_PROBABILITY",
    "COVERAGE_FACTOR",
    "TOLERANCE_CLASSES",
    "ToleranceClass",
    "angle_tolerance_rad",
    "decide",
    "linear_tolerance_mm",
    "radius_tolerance_mm",
]
