"""Emulated GigE Vision cameras: control and stream over UDP, a GenICam description, and faults.

Time and pictures come from outside. Written from public register layouts and what strangers say
on the wire (docs/protocols/gige_vision.md), never from the driver.
"""

from .device import CameraConfig, Faults, GenicamDevice, Peer, PictureSource
from .features import PixelFormat, Sensor
from .server import GenicamServer

__all__ = [
    "CameraConfig",
    "Faults",
    "GenicamDevice",
    "GenicamServer",
    "Peer",
    "PictureSource",
    "PixelFormat",
    "Sensor",
]
