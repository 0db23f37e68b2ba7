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

__all__ = [
    "NO_BUDGET",
    "Characteristic",
    "CharacteristicKind",
    "EdgeLine",
    "EdgePairGeometry",
    "Geometry",
    "Look",
    "Measured",
    "Rim",
    "RimGeometry",
]
