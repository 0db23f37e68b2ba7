"""A part dimensioned as on a drawing: holes, planes, rounds; then the limits a drawing states."""

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
