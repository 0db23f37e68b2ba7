"""Dry runs: the motions of a recipe without its part (ADR 45).

`lifting.py` raises a plan's motions off everything, `session.py` drives them in a visit.
"""

from .lifting import LiftedStep, dry_scene, lift_plan, motions_of
from .session import DryOrder, DryPlan, DrySession, dry_plan

__all__ = [
    "DryOrder",
    "DryPlan",
    "DrySession",
    "LiftedStep",
    "dry_plan",
    "dry_scene",
    "lift_plan",
    "motions_of",
]
