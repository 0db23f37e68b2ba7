"""Search for the sequence of grasps, and for the views under each."""

from ._exact import exact_cover
from ._greedy import greedy
from ._problem import (
    MAX_GRASP_COUNT,
    GraspSequence,
    Problem,
    live_grasps,
    needed_of,
    refuted,
    solution_of,
)
from ._search import COARSE, FULL, Effort
from ._solve import solve
from .order import EXACT_STOPS, best_order

__all__ = [
    "COARSE",
    "EXACT_STOPS",
    "FULL",
    "MAX_GRASP_COUNT",
    "Effort",
    "GraspSequence",
    "Problem",
    "best_order",
    "exact_cover",
    "greedy",
    "live_grasps",
    "needed_of",
    "refuted",
    "solution_of",
    "solve",
]
