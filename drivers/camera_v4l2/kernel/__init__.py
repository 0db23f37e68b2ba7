"""A camera as the kernel offers it: numbers and structs, calls, nodes, errors; no picture yet.

The same calls reach an emulated camera over a socket, where it cannot have a node.
"""

from . import abi
from ._device import Device
from ._discovery import DEV_ROOT, SYSFS_ROOT, FoundNode, find_node, list_nodes
from ._explain import GONE, explain, explain_open, explained
from ._socket_calls import UNIX_PREFIX, SocketCalls
from ._syscalls import BufferMap, KernelCalls, SysCalls
from ._tapped import TappedCalls

__all__ = [
    "DEV_ROOT",
    "GONE",
    "SYSFS_ROOT",
    "UNIX_PREFIX",
    "BufferMap",
    "Device",
    "FoundNode",
    "KernelCalls",
    "SocketCalls",
    "SysCalls",
    "TappedCalls",
    "abi",
    "explain",
    "explain_open",
    "explained",
    "find_node",
    "list_nodes",
]
