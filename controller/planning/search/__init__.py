"""Which grips to hold the part with in turn, and which views to take under each."""

from ._cover import View, best_order, cover
from ._rank import GripSequence, ranked_sequences

__all__ = ["GripSequence", "View", "best_order", "cover", "ranked_sequences"]
