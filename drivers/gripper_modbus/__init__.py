"""Robotiq 2F gripper over Modbus: how wide the jaws are and whether they hold something.

Knows the register map (modbus_devices.md 2) and not which part is held. Not responsible for the
line, which others may share: that is `drivers.modbus_link`.
"""

from ._config import GripperConfig
from ._gripper import Gripper, StoppedError
from ._registers import ActivationState, Counts, ObjectState
from ._status import GripEvidence, GripperStatus, GripResult, Hold

__all__ = [
    "ActivationState",
    "Counts",
    "GripEvidence",
    "GripResult",
    "Gripper",
    "GripperConfig",
    "GripperStatus",
    "Hold",
    "ObjectState",
    "StoppedError",
]
