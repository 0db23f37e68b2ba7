"""The rooms of planning put together: what is prepared, searched, built, proven, and why not."""

from .certificates import Certificate, certify
from .disambiguate import TableHypothesis, identify, plan_under_ambiguity
from .planner import plan_from, plan_part
from .prepare import prepare_part, with_grasps, with_rests

__all__ = [
    "Certificate",
    "TableHypothesis",
    "certify",
    "identify",
    "plan_from",
    "plan_part",
    "plan_under_ambiguity",
    "prepare_part",
    "with_grasps",
    "with_rests",
]
