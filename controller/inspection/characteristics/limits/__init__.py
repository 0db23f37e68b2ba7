"""Limits of a value: general tolerances, fits, a cell's capability, the decision."""

from controller.config.characteristics import CONFORMANCE_PROBABILITY

from .capability import (
    MAX_SHARE,
    Accuracy,
    Capability,
    Station,
    capability_of,
    promised_budget_mm,
    promised_mm,
    zone_mm,
)
from .decision import COVERAGE_FACTOR, decide, open_zones
from .fits import fit_limits_mm
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
    "MAX_SHARE",
    "TOLERANCE_CLASSES",
    "Accuracy",
    "Capability",
    "Station",
    "ToleranceClass",
    "angle_tolerance_rad",
    "capability_of",
    "decide",
    "fit_limits_mm",
    "linear_tolerance_mm",
    "open_zones",
    "promised_budget_mm",
    "promised_mm",
    "radius_tolerance_mm",
    "zone_mm",
]
