"""V4L2 capture: a frame exposed wholly after an instant, with when and how it was taken.

A thin layer of our own over the kernel's ioctls. Not responsible for light, lens or what the
picture shows.
"""

from ._camera import Camera, system_calls_for
from ._controls import ControlInfo, ControlSetting
from ._decode import BrokenPictureError, decode
from ._discovery import FoundNode, find_node, list_nodes
from ._selection import StampSource
from ._socket_calls import SocketCalls
from ._syscalls import KernelCalls, SysCalls
from ._types import CameraConfig, CameraIdentity, CameraStats, Frame

__all__ = [
    "BrokenPictureError",
    "Camera",
    "CameraConfig",
    "CameraIdentity",
    "CameraStats",
    "ControlInfo",
    "ControlSetting",
    "FoundNode",
    "Frame",
    "KernelCalls",
    "SocketCalls",
    "StampSource",
    "SysCalls",
    "decode",
    "find_node",
    "list_nodes",
    "system_calls_for",
]
