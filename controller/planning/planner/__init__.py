"""The rooms of planning put together: what is prepared, searched, built, proven, and why not."""

from .certificates import Certificate, certify
from .planner import plan_from, plan_part
from .prepare import prepare_part, with_grips, with_rests
from .settling import Reading, plan_in_doubt, told

__all__ = [
    "Certificate",
    "Reading",
    "certify",
    "plan_from",
    "plan_in_doubt",
    "plan_part",
    "prepare_part",
    "told",
    "with_grips",
    "with_rests",
]
