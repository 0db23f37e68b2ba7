"""UMI RTX / RT100 arm on a serial line: moves its axes; knows nothing of their load.

Source of all facts: umi_rtx.md. Four rooms, upwards: `protocol` (tables and bytes), `line` (who
listens, one request at a time), `motion` (the motors in counts); beside them, without any device,
`model` (joints, poses, limits, timing). `UmiScara` stands above all of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from ..kinds import Arm, Driver, JawReading, Site, Stop
from ._arm import UmiScara
from ._config import ArmConfig
from ._session import ArmIdentity, PowerOffError
from .line import (
    LineUncertainError,
    LinkConfig,
    RecordedArm,
    SerialTransport,
    Trace,
    Transport,
    WireExchange,
)
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
    "RECORDED_DRIVER",
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

MAX_PLAY_DEG: Final = 2.0  # larger play means a broken gear
MAX_JAW_ZERO_MM: Final = 5.0
# limits of each setting; SPEED and MAX_FORCE as drivers have used them
_LIMITS: Final = (
    ("jaw_speed", 1, c.MAX_SPEED),
    ("jaw_force", 1, 60),
    ("homing_zed_speed", 1, 100),
    ("homing_zed_force", 1, 60),
    ("homing_zed_s", 1, 300),
    ("homing_s", 1, 300),
    ("arrival_counts", 0, 20),
    ("arrival_s", 0, 10),
)
_COUNTS_PER_DEG: Final = {
    "elbow": c.ELBOW_COUNTS_PER_DEG,
    "shoulder": c.SHOULDER_COUNTS_PER_DEG,
    "yaw": c.YAW_COUNTS_PER_DEG,
    "wrist1": c.WRIST_COUNTS_PER_DEG,
    "wrist2": c.WRIST_COUNTS_PER_DEG,
}


@dataclass(frozen=True, slots=True)
class UmiSettings:
    """The settings that set one UMI RTX apart from another, as measured on it.

    Attributes
    ----------
    play_deg : play of the gears of `elbow`, `shoulder`, `yaw`, `wrist1`, `wrist2`, from one flank
        to the other, in degrees of the motor's own scale (umi_rtx.md 5.1)
    jaw_zero_mm : opening of the jaws where their counter means 0
    jaw_speed, jaw_force : SPEED with which the jaws close on something, MAX_FORCE with which they
        move in empty air (umi_rtx.md 5.6; the arm gives neither a unit)
    homing_zed_speed, homing_zed_force : SPEED and MAX_FORCE on the way up (umi_rtx.md 3.3)
    homing_zed_s, homing_s : time limits for zed, and for any other axis, to reach its stop, as in
        umi_rtx.md 4.6 [cell s]
    arrival_counts : an axis has arrived within so many counts beyond its own dead band
    arrival_s : time limit for an axis at rest to come this near [cell s]
    """

    play_deg: Mapping[str, float] = field(default_factory=dict)
    jaw_zero_mm: float = 0.0
    jaw_speed: int = 50
    jaw_force: int = 40
    homing_zed_speed: int = 30
    homing_zed_force: int = 30
    homing_zed_s: float = 60.0
    homing_s: float = 30.0
    arrival_counts: int = 2
    arrival_s: float = 0.5

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            if not low <= value <= high:  # not a number, too
                raise ValueError(f"{name}: {low:g} to {high:g}, not {value:g}")
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

    def config(self, silence_s: float) -> ArmConfig:
        """Return the arm's configuration with these settings.

        Parameters
        ----------
        silence_s : a line on which no byte has come back for so long is silent [cell s]
        """
        return ArmConfig(
            link=LinkConfig(silence_s=silence_s),
            homing=HomingConfig(
                zed_speed=self.homing_zed_speed,
                zed_force=self.homing_zed_force,
                zed_timeout_s=self.homing_zed_s,
                timeout_s=self.homing_s,
            ),
            gripper=GripperLaw(offset_mm=self.jaw_zero_mm),
            play_counts=self.play_counts,
            gripper_force=self.jaw_force,
            grasp_speed=self.jaw_speed,
            arrival_slack_counts=self.arrival_counts,
            settle_s=self.arrival_s,
        )


def _build(site: Site, settings: UmiSettings) -> UmiScara:
    return _built(site, settings, partial(SerialTransport, site.address), site.address)


def _build_recorded(site: Site, settings: UmiSettings) -> UmiScara:
    recorded = RecordedArm(Path(site.folder, site.address).absolute(), site.name, site.clock)
    return _built(site, settings, recorded.open)


def _built(
    site: Site, settings: UmiSettings, make: Callable[[], Transport], line: str | None = None
) -> UmiScara:
    config = settings.config(site.silence_s)
    tap = site.wires.line(site.name)
    if tap is None:
        return UmiScara(make, config=config, clock=site.clock, line=line)
    opens = partial(tap.opening, make)

    def trace(exchange: WireExchange) -> None:
        if not exchange.reply:
            tap.unanswered()

    return UmiScara(opens, config=config, clock=site.clock, trace=trace, tap=tap, line=line)


DRIVER: Driver[Arm, UmiSettings] = Driver(UmiSettings, _build, node_group="dialout")
RECORDED_DRIVER: Driver[Arm, UmiSettings] = Driver(
    UmiSettings, _build_recorded, keeps_cell_time=True
)
