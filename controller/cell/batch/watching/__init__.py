"""Watchers of everything that no action reports.

`links.py` watches the devices' lines and the event loop; `conditions.py` interlocks, a part that
leaves the fixed gripper, the disk.
"""

from .conditions import (
    DiskWatcher,
    FixedGripperWatcher,
    InterlockWatcher,
    MotorSupplyWatcher,
    Report,
    Watcher,
)
from .links import ArmWatcher, LoopWatcher, ModbusWatcher

__all__ = [
    "ArmWatcher",
    "DiskWatcher",
    "FixedGripperWatcher",
    "InterlockWatcher",
    "LoopWatcher",
    "ModbusWatcher",
    "MotorSupplyWatcher",
    "Report",
    "Watcher",
]
