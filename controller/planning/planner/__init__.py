"""The planner: preparation, search, construction, proof, and reasons for surface not shown."""

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
