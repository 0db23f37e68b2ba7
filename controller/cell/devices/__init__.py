"""The devices of a cell: their drivers, addresses, clock, interlocks and stops.

`build.py` makes the drivers that `controller.setup.drivers` finds. `clocks.py` finds their clock.
`emulator.py` starts the emulated devices. `interlocks.py` checks whether anything may move.
`stopping.py` stops everything. `lamps.py` names the lamps of the table and the station.
"""

from .build import DeviceBuilder, Devices, polling_of, resolve

__all__ = ["DeviceBuilder", "Devices", "polling_of", "resolve"]
