"""A camera as the kernel offers it: numbers and structs, calls, nodes, errors; no picture yet.

The same calls reach an emulated camera over a socket, where it cannot have a node.
"""

from . import abi
from ._device import Device
from ._discovery import DEV_ROOT, SYSFS_ROOT, FoundNode, find_node, list_nodes
from ._explain import GONE, explain, explain_open, explained
from ._socket_calls import UNIX_PREFIX, SocketCalls
from ._syscalls import KernelCalls, SysCalls

__all__ = [
    "DEV_ROOT",
    "GONE",
    "SYSFS_ROOT",
    "UNIX_PREFIX",
    "Device",
    "FoundNode",
    "KernelCalls",
    "SocketCalls",
    "SysCalls",
    "abi",
    "explain",
    "explain_open",
    "explained",
    "find_node",
    "list_nodes",
]
