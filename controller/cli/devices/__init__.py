"""Devices of a cell: are they all there, and emulated ones for any client."""

from .commands import doctor, emulate

__all__ = ["doctor", "emulate"]
