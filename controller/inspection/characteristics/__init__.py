"""What is asked of a part, and how a measured value is decided upon."""

from ._types import (
    NO_BUDGET,
    Characteristic,
    CharacteristicKind,
    EdgeLine,
    EdgePairGeometry,
    Geometry,
    Look,
    Measured,
    Rim,
    RimGeometry,
)
from .derive import derive
from .limits import CONFORMANCE_PROBABILITY, TOLERANCE_CLASSES, ToleranceClass, decide
from .verdicts import verdict_of

__all__ = [
    "CONFORMANCE_PROBABILITY",
    "NO_BUDGET",
    "TOLERANCE_CLASSES",
    "Characteristic",
    "CharacteristicKind",
    "EdgeLine",
    "EdgePairGeometry",
    "Geometry",
    "Look",
    "Measured",
    "Rim",
    "RimGeometry",
    "ToleranceClass",
    "decide",
    "derive",
    "verdict_of",
]
