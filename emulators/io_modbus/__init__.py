"""Emulated cell I/O: a Moxa ioLogik E1214 or E1212, and its wiring."""

from ._e1214 import E1214Device
from ._map import E1212, E1214Config
from ._signals import CellSignals

__all__ = ["E1212", "CellSignals", "E1214Config", "E1214Device"]
