"""The camera behind its wires: one lock, a sensor that exposes frames, and its faults."""

from ._device import V4l2Device
from ._faults import Faults
from ._sensor import Clock, PictureSource

__all__ = ["Clock", "Faults", "PictureSource", "V4l2Device"]
