"""Settings of one arm, and the SPEEDs it accepts. Sections (§) are those of umi_rtx.md."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from .line import LinkConfig
from .model import GripperLaw
from .motion import HomingConfig
from .protocol import constants as c
from .protocol.constants import Axis


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """Settings of one arm; all durations in cell seconds.

    Attributes
    ----------
    arrival_slack_counts : tolerance of arrival beyond the axis' own DEAD_BAND
    settle_s : time limit for an axis at rest to come within that tolerance
    nominal_counts_per_s : speed of each axis at SPEED 100 (7), for forecasts and speed ratios
    gripper_force : MAX_FORCE with which the jaws open and close in position moves (§5.6)
    grasp_speed : SPEED with which the jaws close on something (§5.6)
    play_counts : play of each motor's gears, from one flank to the other, as measured [counts]
    """

    link: LinkConfig = field(default_factory=LinkConfig)
    homing: HomingConfig = field(default_factory=HomingConfig)
    gripper: GripperLaw = field(default_factory=GripperLaw)
    arrival_slack_counts: int = 2
    settle_s: float = 0.5
    nominal_counts_per_s: Mapping[Axis, float] = field(
        default_factory=lambda: dict(c.NOMINAL_COUNTS_PER_S)
    )
    gripper_force: int = 40
    grasp_speed: int = 50
    play_counts: Mapping[Axis, float] = field(default_factory=dict)


def check_speeds(speeds: Mapping[Axis, int]) -> None:
    """Check that each SPEED is one that a driver has used (§2.5).

    Raises
    ------
    ValueError : not a whole number from 1 to MAX_SPEED; the message names the axis
    """
    for axis, speed in speeds.items():
        if not 1 <= speed <= c.MAX_SPEED or int(speed) != speed:
            raise ValueError(f"{axis.name}: SPEED is a whole 1 to {c.MAX_SPEED}, not {speed}")
