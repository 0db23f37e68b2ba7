"""Lamps by their pictures: identity, brightness, evenness and settling time.

Arrays in, dataclasses out. A lamp is known by the pattern that its light makes on
the table and on the panel behind the station, as far as both cameras see them.
"""

from ._evenness import evenness, saturated_share
from ._patterns import (
    GRID,
    Assignment,
    CameraBackground,
    PatternLamp,
    assign,
    expected_pattern,
    seen_pattern,
)
from ._steadiness import TooFewSamplesError, seconds_to_steady

__all__ = [
    "GRID",
    "Assignment",
    "CameraBackground",
    "PatternLamp",
    "TooFewSamplesError",
    "assign",
    "evenness",
    "expected_pattern",
    "saturated_share",
    "seconds_to_steady",
    "seen_pattern",
]
