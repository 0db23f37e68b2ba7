"""Plans, certificates and prepared parts, from the cache if they are there.

`planning.py` computes the results missing in the cache; `stored.py` stores all three, and checks
them when they are read.
"""

from .planning import PlanCache, planner_hash
from .stored import Certified, KeptPlan

__all__ = [
    "Certified",
    "KeptPlan",
    "PlanCache",
    "planner_hash",
]
