"""The wires to the camera: a FUSE node, or a unix socket with the same ioctl structs."""

from ._fuse import FuseMount, can_mount
from ._fuse_wire import unmount
from ._socket import SocketCamera

__all__ = ["FuseMount", "SocketCamera", "can_mount", "unmount"]
