"""The devices of a cell: their drivers, addresses and clock, and what lets them move or stops them.

`build.py` makes the drivers that `controller.setup.drivers` finds; `clocks.py` finds their clock,
`emulator.py` starts what is emulated; `lock.py` keeps a second run out, `interlocks.py` checks
whether anything may move, `stopping.py` stops everything, `lamps.py` names the lamps of table and
station.
"""

from .build import DeviceBuilder, Devices, resolve

__all__ = ["DeviceBuilder", "Devices", "resolve"]
