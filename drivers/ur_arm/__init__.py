"""Universal Robots arm (e-Series, and CB3's UR5): moves its joints; knows nothing of their load.

Source of all facts: ur.md. Rooms, upwards: `protocol` (tables and bytes), `ports` (RTDE, dashboard,
script), `jaws` (the gripper on the flange); beside them, without any device, `model` (joints,
poses, links, timing). `UrArm` stands above all of them.
"""

from typing import Final

from ..gripper_modbus import GripperConfig
from ..kinds import ArmDriver, Site
from ..modbus_link import TcpAddress
from ._arm import UrArm
from ._config import ControllerAddress, UrSettings
from ._errors import LocalControlError, OutOfRangeError, PowerOffError, SafetyStopError
from ._session import ArmIdentity
from .jaws import Jaws, ModbusJaws, UrcapJaws
from .model import MODELS, LinkBox, UrFigures, UrModel, UrShape, UrTiming, describe

__all__ = [
    "DRIVER",
    "MODELS",
    "ArmIdentity",
    "ControllerAddress",
    "Jaws",
    "LinkBox",
    "LocalControlError",
    "ModbusJaws",
    "OutOfRangeError",
    "PowerOffError",
    "SafetyStopError",
    "UrArm",
    "UrFigures",
    "UrModel",
    "UrSettings",
    "UrShape",
    "UrTiming",
    "UrcapJaws",
    "describe",
]


def _build(site: Site, settings: UrSettings) -> UrArm:
    shape = site.shape
    if not isinstance(shape, UrShape):
        raise ValueError("`arm.shape` of the cell file describes this arm, and is missing")
    address = ControllerAddress.of(site.address)
    return UrArm(
        address, shape, settings, _jaws(site, address, settings), site.clock, site.silence_s
    )


def _jaws(site: Site, address: ControllerAddress, settings: UrSettings) -> Jaws:
    config = GripperConfig(
        unit=settings.gripper_unit,
        open_mm=settings.jaw_open_mm,
        counts_open=settings.jaw_open_counts,
        counts_closed=settings.jaw_closed_counts,
        default_speed_mm_s=settings.jaw_speed_mm_s,
    )
    if settings.gripper == "modbus":
        host, _, port = settings.gripper_address.rpartition(":")
        return ModbusJaws(TcpAddress(host, int(port)), site.clock, config)
    return UrcapJaws(settings.host or address.host, settings.gripper_port, site.clock, config)


DRIVER: Final[ArmDriver[UrSettings, UrShape, UrModel]] = ArmDriver(
    # three connections, and states that come unasked, are not recorded
    UrSettings,
    _build,
    UrShape,
    describe,
    is_recorded=False,
)
