"""Which grips to hold the part with in turn, and which views to take under each."""

from ._cover import View, best_order, cover
from ._greedy import greedy
from ._problem import MAX_GRIPS, Problem, Solution, live_grips, needed_of, priced, refuted
from ._rank import GripSequence, ranked_sequences
from ._solve import COARSE, FULL, Effort, solve

__all__ = [
    "COARSE",
    "FULL",
    "MAX_GRIPS",
    "Effort",
    "GripSequence",
    "Problem",
    "Solution",
    "View",
    "best_order",
    "cover",
    "greedy",
    "live_grips",
    "needed_of",
    "priced",
    "ranked_sequences",
    "refuted",
    "solve",
]
