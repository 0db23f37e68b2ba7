"""The seven motors: set, started, watched to their rest, homed, and whether to trust their counts.

It knows counts, no joint angle and no limit.
"""

from ._axes import Axes
from ._counters import Known, judge_counters
from ._homing import Homing, HomingConfig, HomingError
from ._moves import (
    AxisStalledError,
    MotionStoppedError,
    Watch,
    forecast_s,
    on_ip,
    start,
    synchronised_speeds,
    verify_arrival,
)

__all__ = [
    "Axes",
    "AxisStalledError",
    "Homing",
    "HomingConfig",
    "HomingError",
    "Known",
    "MotionStoppedError",
    "Watch",
    "forecast_s",
    "judge_counters",
    "on_ip",
    "start",
    "synchronised_speeds",
    "verify_arrival",
]
