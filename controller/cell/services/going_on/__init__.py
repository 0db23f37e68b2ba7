"""Going on: with the part of an interrupted run, and after a pause with the door open."""

from .resuming import Resumption, hold_of, park_interrupted, sighting_of, verdict_of
from .standstill import Standstill

__all__ = [
    "Resumption",
    "Standstill",
    "hold_of",
    "park_interrupted",
    "sighting_of",
    "verdict_of",
]
