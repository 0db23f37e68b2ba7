"""The arm without the device: kinematics, limits, links, timing; no I/O.

Planning requires the same of every arm, by a protocol of its own (`controller.planning.model.arm`).
`UrModel` fits it without importing it. Facts are those of ur.md.
"""

from . import kinematics
from ._build import MODELS, UrShape, describe
from ._figures import UrFigures
from ._model import LinkBox, UrModel
from ._sizes import UrSize
from ._timing import UrTiming

__all__ = [
    "MODELS",
    "LinkBox",
    "UrFigures",
    "UrModel",
    "UrShape",
    "UrSize",
    "UrTiming",
    "describe",
    "kinematics",
]
