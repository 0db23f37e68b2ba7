"""The camera behind its socket: registers, control, a sensor that exposes, and its faults."""

from .control import Peer
from .device import CameraConfig, GenicamDevice
from .faults import Faults
from .sensor import Clock, Picture, PictureSource

__all__ = [
    "CameraConfig",
    "Clock",
    "Faults",
    "GenicamDevice",
    "Peer",
    "Picture",
    "PictureSource",
]
