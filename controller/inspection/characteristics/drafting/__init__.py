"""Dimensioning of a part as on a drawing: holes, planes, rounds; then the stated limits."""

from .drawn import with_drawn
from .planes import PlanePair, between
from .writer import nominal_characteristics, pair_characteristic

__all__ = [
    "PlanePair",
    "between",
    "nominal_characteristics",
    "pair_characteristic",
    "with_drawn",
]
