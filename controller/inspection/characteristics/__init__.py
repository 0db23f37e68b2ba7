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
from .limits import TOLERANCE_CLASSES, ToleranceClass

__all__ = [
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
    "derive",
]
