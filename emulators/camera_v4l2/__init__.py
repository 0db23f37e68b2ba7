"""Emulated V4L2 cameras: the ioctls, polls and mappings that unmodified clients expect, and faults.

Time and pictures are handed in; how the bytes travel (a FUSE node, or a unix socket where FUSE
cannot be mounted) is `CameraServer`'s matter. Read after the kernel's V4L2 documentation and
`linux/videodev2.h`, never after the driver.
"""

from ._control_specs import DEFAULT_CONTROLS, ControlSpec, Kind
from ._device import V4l2Device
from ._faults import Faults
from ._fuse import FuseMount, can_mount
from ._pattern import ClockPattern, read_clock_pattern
from ._sensor import Clock, PictureSource
from ._server import CameraServer
from ._settings import CameraConfig
from ._socket import SocketCamera
from .formats import Picture, PixelFormat

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
