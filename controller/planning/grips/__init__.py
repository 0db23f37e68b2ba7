"""Where a jaw can hold a part, and which of many grips to plan with."""

from ._select import clear_of_table, resting_pose, select_arm_grips, spread, turned_over
from ._synthesis import find_seeds, synthesise_grips

__all__ = [
    "clear_of_table",
    "find_seeds",
    "resting_pose",
    "select_arm_grips",
    "spread",
    "synthesise_grips",
    "turned_over",
]
