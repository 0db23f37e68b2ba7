"""Emulated V4L2 cameras: the ioctls, polls and mappings that unmodified clients expect, and faults.

Time and pictures come from outside. `CameraServer` decides how the bytes travel: over a FUSE node,
or over a unix socket where FUSE cannot be mounted. Written from the kernel's V4L2
documentation and `linux/videodev2.h`, never from the driver.
"""

from emulators.clock_pattern import ClockPattern, read_clock_pattern

from .device import Clock, Faults, PictureSource, V4l2Device
from .kernel import DEFAULT_CONTROLS, CameraConfig, ControlSpec, Kind, Picture, PixelFormat
from .server import CameraServer
from .wires import FuseMount, SocketCamera, can_mount, unmount

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
    "unmount",
]
