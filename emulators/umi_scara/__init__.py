"""The UMI RTX arm: motors and stops (`ArmModel`), its line (`ArmWire`), a terminal (`ArmServer`).

A second reading of umi_rtx.md, shared with nobody; umi_rtx.md 7 is the specification.
"""

from ._axes import COUNTS_PER_DEG, ZED_COUNTS_PER_MM, ArmJoints, Axis
from ._errors import ArmErrors
from ._faults import Faults
from ._model import ArmModel
from ._server import ArmServer
from ._wire import ArmWire

__all__ = [
    "COUNTS_PER_DEG",
    "ZED_COUNTS_PER_MM",
    "ArmErrors",
    "ArmJoints",
    "ArmModel",
    "ArmServer",
    "ArmWire",
    "Axis",
    "Faults",
]
