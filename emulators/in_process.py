"""The emulated cell without its process: a simulation keeps its time and carries its bytes.

The same devices and the same world as behind the ports, on a clock that is handed in. The control
port is not opened: ``Cell.faults`` obeys its orders where they are handed over.
"""

from ._cell import Cell, CellOptions
from .cameras import EmulatedCamera
from .faults import CameraPlugs, Verbs

__all__ = ["CameraPlugs", "Cell", "CellOptions", "EmulatedCamera", "Verbs"]
