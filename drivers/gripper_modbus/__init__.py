"""Robotiq 2F gripper over Modbus: how wide the jaws are and whether they hold something.

Knows the register map (modbus_devices.md 2) and not which part is held. Not responsible for the
line, which others may share: that is `drivers.modbus_link`.
"""

from ..kinds import Driver, FixedGripper, Hold, NoSettings, Site
from ._config import GripperConfig
from ._gripper import Gripper, StoppedError
from ._registers import ActivationState, Counts, ObjectState
from ._status import GraspEvidence, GraspResult, GripperStatus

__all__ = [
    "DRIVER",
    "ActivationState",
    "Counts",
    "GraspEvidence",
    "GraspResult",
    "Gripper",
    "GripperConfig",
    "GripperStatus",
    "Hold",
    "ObjectState",
    "StoppedError",
]


def _build(site: Site, _: NoSettings) -> Gripper:
    return Gripper(site.open_link(), GripperConfig(unit=site.section["unit"]))


def _max_force_n(_: NoSettings) -> float:
    return GripperConfig().max_force_n


DRIVER: Driver[FixedGripper, NoSettings] = Driver(NoSettings, _build, max_force_n=_max_force_n)
