"""The cell's digital inputs and outputs over a Moxa ioLogik E1214 (Modbus TCP).

Healthy is 1, and what is not freshly known is never OK. Not responsible for safety: that is
hard-wired, and what arrives here is a copy of it.
"""

from ._config import (
    PLANNED_INPUTS,
    PLANNED_OUTPUTS,
    Debounce,
    InputChannel,
    IoConfig,
    OutputChannel,
)
from ._io import CellIo, Watch
from ._signals import Change, Signal, Snapshot

__all__ = [
    "PLANNED_INPUTS",
    "PLANNED_OUTPUTS",
    "CellIo",
    "Change",
    "Debounce",
    "InputChannel",
    "IoConfig",
    "OutputChannel",
    "Signal",
    "Snapshot",
    "Watch",
]
