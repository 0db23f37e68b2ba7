"""UMI RTX / RT100 arm on a serial line: moves its axes; does not know what they carry.

Source of all facts: umi_rtx.md. Four rooms, upwards: `protocol` (tables and bytes), `line` (who
listens, one request at a time), `motion` (the motors in counts); beside them, without any device,
`model` (joints, poses, limits, timing). `UmiScara` stands above all of them.
"""

from ..kinds import Arm, Driver, JawReading, NoSettings, Site, Stop
from ._arm import UmiScara
from ._config import ArmConfig
from ._session import ArmIdentity, PowerOffError
from .line import LineUncertainError, LinkConfig, SerialTransport, Trace, Transport, WireExchange
from .model import (
    ArmGeometry,
    GripperLaw,
    LinkBox,
    OutOfRangeError,
    UmiModel,
    UmiTiming,
    kinematics,
)
from .motion import (
    AxisStalledError,
    HomingConfig,
    HomingError,
    MotionStoppedError,
    forecast_s,
    synchronised_speeds,
)
from .protocol.constants import Axis, Ip, Parameter, StatusBits

__all__ = [
    "DRIVER",
    "ArmConfig",
    "ArmGeometry",
    "ArmIdentity",
    "Axis",
    "AxisStalledError",
    "GripperLaw",
    "HomingConfig",
    "HomingError",
    "Ip",
    "JawReading",
    "LineUncertainError",
    "LinkBox",
    "LinkConfig",
    "MotionStoppedError",
    "OutOfRangeError",
    "Parameter",
    "PowerOffError",
    "SerialTransport",
    "StatusBits",
    "Stop",
    "Trace",
    "Transport",
    "UmiModel",
    "UmiScara",
    "UmiTiming",
    "WireExchange",
    "forecast_s",
    "kinematics",
    "synchronised_speeds",
]


def _build(site: Site, _: NoSettings) -> UmiScara:
    config = ArmConfig(link=LinkConfig(silence_s=site.silence_s))
    return UmiScara(site.address, config=config, clock=site.clock)


DRIVER: Driver[Arm, NoSettings] = Driver(NoSettings, _build)
