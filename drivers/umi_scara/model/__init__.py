"""The arm without the device: kinematics, limits, jaws, links, timing; no I/O.

Planning requires the same of every arm, by a protocol of its own (`controller.planning.model.arm`).
`UmiModel` fits it without importing it. Facts are those of umi_rtx.md.
"""

from . import kinematics, limits
from ._figures import UmiFigures
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
    "UmiFigures",
    "UmiModel",
    "UmiTiming",
    "kinematics",
    "limits",
]
