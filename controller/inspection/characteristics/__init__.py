"""Characteristics required of a part, and the decision on a measured value."""

from ._types import (
    GENERAL,
    Characteristic,
    CharacteristicKind,
    EdgeLine,
    EdgePairGeometry,
    Geometry,
    Look,
    Measured,
    Rim,
    RimCourse,
    RimGeometry,
    place_of,
    rim_directions,
)
from .asked import LEFT_OUT, Asked, AskedError, characteristics_of
from .derive import derive
from .limits import (
    CONFORMANCE_PROBABILITY,
    TOLERANCE_CLASSES,
    Accuracy,
    Capability,
    Station,
    ToleranceClass,
    capability_of,
    decide,
)
from .verdicts import Standing, standing_of, verdict_of, with_capability, worse

__all__ = [
    "CONFORMANCE_PROBABILITY",
    "GENERAL",
    "LEFT_OUT",
    "TOLERANCE_CLASSES",
    "Accuracy",
    "Asked",
    "AskedError",
    "Capability",
    "Characteristic",
    "CharacteristicKind",
    "EdgeLine",
    "EdgePairGeometry",
    "Geometry",
    "Look",
    "Measured",
    "Rim",
    "RimCourse",
    "RimGeometry",
    "Standing",
    "Station",
    "ToleranceClass",
    "capability_of",
    "characteristics_of",
    "decide",
    "derive",
    "place_of",
    "rim_directions",
    "standing_of",
    "verdict_of",
    "with_capability",
    "worse",
]
