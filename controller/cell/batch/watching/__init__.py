"""Watchers of everything that no action reports.

`links.py` watches the devices' lines and the event loop; `conditions.py` interlocks, a part that
leaves the fixed gripper, the disk.
"""

from .conditions import (
    BatchWatcher,
    DiskWatcher,
    FixedGripperWatcher,
    InterlockWatcher,
    MotorSupplyWatcher,
    Report,
)
from .links import ArmWatcher, LoopWatcher, ModbusWatcher

__all__ = [
    "ArmWatcher",
    "BatchWatcher",
    "DiskWatcher",
    "FixedGripperWatcher",
    "InterlockWatcher",
    "LoopWatcher",
    "ModbusWatcher",
    "MotorSupplyWatcher",
    "Report",
]
