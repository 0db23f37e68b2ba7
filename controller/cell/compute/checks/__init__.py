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

__all__ = [
    "Checked",
    "CheckedCharacteristic",
    "CheckedPose",
    "check_characteristics",
    "check_defects",
    "check_every_pose",
    "check_job",
    "check_plans",
    "check_sizes",
]
