"""Cell I/O that is not there: a Moxa ioLogik E1214 and the contacts and lights wired to it."""

from ._e1214 import E1214Device, StackLight
from ._map import E1214Config
from ._signals import CellSignals

__all__ = ["CellSignals", "E1214Config", "E1214Device", "StackLight"]
