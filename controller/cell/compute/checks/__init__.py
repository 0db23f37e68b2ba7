"""Checks of files alone: a recipe's feasibility in a cell, and the cell's capability."""

from .characteristics import CheckedCharacteristic, check_characteristics
from .checking import (
    Checked,
    CheckedPose,
    check_every_pose,
    check_job,
    check_plans,
    check_sizes,
)
from .defects import check_defects
from .forecast import Forecast, ShortFace, forecast

__all__ = [
    "Checked",
    "CheckedCharacteristic",
    "CheckedPose",
    "Forecast",
    "ShortFace",
    "check_characteristics",
    "check_defects",
    "check_every_pose",
    "check_job",
    "check_plans",
    "check_sizes",
    "forecast",
]
