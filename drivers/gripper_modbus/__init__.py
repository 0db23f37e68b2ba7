"""Robotiq 2F gripper over Modbus: the opening of its jaws and their hold.

Knows the register map (modbus_devices.md 2) and not which part is held. Not responsible for the
line, which others may share: that is `drivers.modbus_link`.
"""

from dataclasses import dataclass

from ..kinds import Driver, FixedGripper, Hold, Site
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
    "RobotiqSettings",
    "StoppedError",
]


@dataclass(frozen=True)
class RobotiqSettings:
    """The keys allowed under `settings`.

    Attributes
    ----------
    speed_mm_s : speed of the jaws, 20 to 150 (modbus_devices.md 2.5)
    """

    speed_mm_s: float = 80.0

    def __post_init__(self) -> None:
        GripperConfig(default_speed_mm_s=self.speed_mm_s)


def _build(site: Site, settings: RobotiqSettings) -> Gripper:
    config = GripperConfig(unit=site.section["unit"], default_speed_mm_s=settings.speed_mm_s)
    return Gripper(site.open_link(), config)


def _max_force_n(_: RobotiqSettings) -> float:
    return GripperConfig().max_force_n


DRIVER: Driver[FixedGripper, RobotiqSettings] = Driver(
    RobotiqSettings, _build, max_force_n=_max_force_n, node_group="dialout"
)
