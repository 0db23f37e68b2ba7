"""Emulated V4L2 cameras: the ioctls, polls and mappings that unmodified clients expect, and faults.

Time and pictures are handed in; how the bytes travel (a FUSE node, or a unix socket where FUSE
cannot be mounted) is `CameraServer`'s matter. Read after the kernel's V4L2 documentation and
`linux/videodev2.h`, never after the driver.
"""

from ._pattern import ClockPattern, read_clock_pattern
from .device import Clock, Faults, PictureSource, V4l2Device
from .kernel import DEFAULT_CONTROLS, CameraConfig, ControlSpec, Kind, Picture, PixelFormat
from .server import CameraServer
from .wires import FuseMount, SocketCamera, can_mount

__all__ = [
    "DEFAULT_CONTROLS",
    "CameraConfig",
    "CameraServer",
    "Clock",
    "ClockPattern",
    "ControlSpec",
    "Faults",
    "FuseMount",
    "Kind",
    "Picture",
    "PictureSource",
    "PixelFormat",
    "SocketCamera",
    "V4l2Device",
    "can_mount",
    "read_clock_pattern",
]
