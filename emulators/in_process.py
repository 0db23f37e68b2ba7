"""The emulated cell without its process: a simulation keeps its time and carries its bytes.

The same devices and the same world as behind the ports, on a clock that is handed in. The control
port is not opened; its orders are obeyed where they are handed over.
"""

from ._cell import CameraPlugs, Cell, CellOptions
from ._control import ControlPort

__all__ = ["CameraPlugs", "Cell", "CellOptions", "ControlPort"]
