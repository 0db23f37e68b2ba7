"""The arm as those see it who plan its motions: kinematics, limits, links, timing; no I/O.

Planning asks the same of every arm, in terms of its own (`controller.planning.model.arm`). This
model fits them without knowing them. Facts are those of umi_rtx.md.
"""

from . import kinematics, limits
from ._jaws import GripperLaw
from ._model import LinkBox, UmiModel
from ._timing import UmiTiming
from .kinematics import ArmGeometry
from .limits import OutOfRangeError

__all__ = [
    "ArmGeometry",
    "GripperLaw",
    "LinkBox",
    "OutOfRangeError",
    "UmiModel",
    "UmiTiming",
    "kinematics",
    "limits",
]
