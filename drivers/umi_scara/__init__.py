"""UMI RTX / RT100 arm on a serial line: moves its axes; does not know what they carry.

Source of all facts: umi_rtx.md. Four rooms, upwards: `protocol` (tables and bytes), `line` (who
listens, one request at a time), `motion` (the motors in counts); beside them, without any device,
`model` (joints, poses, limits, timing). `UmiScara` stands above all of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from ..kinds import Arm, Driver, JawReading, Site, Stop
from ._arm import UmiScara
from ._config import ArmConfig
from ._session import ArmIdentity, PowerOffError
from .line import LineUncertainError, LinkConfig, SerialTransport, Trace, Transport, WireExchange
from .model import (
    ArmGeometry,
    GripperLaw,
    LinkBox,
    OutOfRangeError,
    UmiFigures,
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
from .protocol import constants as c
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
    "UmiFigures",
    "UmiModel",
    "UmiScara",
    "UmiSettings",
    "UmiTiming",
    "WireExchange",
    "forecast_s",
    "kinematics",
    "synchronised_speeds",
]

MAX_PLAY_DEG: Final = 2.0  # more than that is a broken gear
MAX_JAW_ZERO_MM: Final = 5.0
_COUNTS_PER_DEG: Final = {
    "elbow": c.ELBOW_COUNTS_PER_DEG,
    "shoulder": c.SHOULDER_COUNTS_PER_DEG,
    "yaw": c.YAW_COUNTS_PER_DEG,
    "wrist1": c.WRIST_COUNTS_PER_DEG,
    "wrist2": c.WRIST_COUNTS_PER_DEG,
}


@dataclass(frozen=True, slots=True)
class UmiSettings:
    """What sets one UMI RTX apart from another, as measured on it.

    Attributes
    ----------
    play_deg : of the gears of `elbow`, `shoulder`, `yaw`, `wrist1`, `wrist2`, from one flank to the
        other, in degrees of the motor's own scale (umi_rtx.md 5.1)
    jaw_zero_mm : opening of the jaws where their counter means 0
    """

    play_deg: Mapping[str, float] = field(default_factory=dict)
    jaw_zero_mm: float = 0.0

    def __post_init__(self) -> None:
        for name, play in self.play_deg.items():
            if name not in _COUNTS_PER_DEG:
                raise ValueError(f"play_deg: {name!r} is none of {', '.join(_COUNTS_PER_DEG)}")
            if not 0 <= play <= MAX_PLAY_DEG:
                raise ValueError(f"play_deg: {name}: 0 to {MAX_PLAY_DEG:g} degrees, not {play:g}")
        if abs(self.jaw_zero_mm) > MAX_JAW_ZERO_MM:
            raise ValueError(
                f"jaw_zero_mm: within {MAX_JAW_ZERO_MM:g} mm either side, not {self.jaw_zero_mm:g}"
            )

    @property
    def play_counts(self) -> dict[Axis, float]:
        """The play of each motor's gears [counts]."""
        return {
            Axis[name.upper()]: play * _COUNTS_PER_DEG[name] for name, play in self.play_deg.items()
        }


def _build(site: Site, settings: UmiSettings) -> UmiScara:
    config = ArmConfig(
        link=LinkConfig(silence_s=site.silence_s),
        gripper=GripperLaw(offset_mm=settings.jaw_zero_mm),
        play_counts=settings.play_counts,
    )
    return UmiScara(site.address, config=config, clock=site.clock)


DRIVER: Driver[Arm, UmiSettings] = Driver(UmiSettings, _build)
