"""The seven motors: set, started, watched to their rest, homed, and whether to trust their counts.

It knows counts, no joint angle and no limit.
"""

from drivers.errors import MotionStoppedError

from ._axes import Axes, ReadingsDifferError
from ._counters import judge_counters, judge_kept_counters
from ._first_contact import read_registers, try_motor
from ._homing import Homing
from ._keeping import KeepingHoming, keeping_park
from ._moves import (
    AxisStalledError,
    MoveWatch,
    forecast_s,
    on_ip,
    start,
    synchronised_speeds,
    verify_arrival,
)
from ._play import GearPlay
from ._positions import Positions, axes_in_turn
from ._stops import HomingConfig, HomingError

__all__ = [
    "Axes",
    "AxisStalledError",
    "GearPlay",
    "Homing",
    "HomingConfig",
    "HomingError",
    "KeepingHoming",
    "MotionStoppedError",
    "MoveWatch",
    "Positions",
    "ReadingsDifferError",
    "axes_in_turn",
    "forecast_s",
    "judge_counters",
    "judge_kept_counters",
    "keeping_park",
    "on_ip",
    "read_registers",
    "start",
    "synchronised_speeds",
    "try_motor",
    "verify_arrival",
]
