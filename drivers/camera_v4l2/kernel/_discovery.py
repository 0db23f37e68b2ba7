"""The node of a camera by its name in cell.yaml.

A camera keeps its serial number and its port, not its node's number: after a replug it may come
back under another. So the sysfs tree is searched, by the kernel's own names
(Documentation/ABI: ``/sys/class/video4linux``); no udev, which a container may lack.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.errors import LinkError, WrongDeviceError
from messages import joined, say

from ._socket_calls import UNIX_PREFIX

SERIAL_PREFIX: Final = "serial:"
PORT_PREFIX: Final = "usb:"
DEV_ROOT: Final = Path("/dev")
SYSFS_ROOT: Final = Path("/sys")


@dataclass(frozen=True, slots=True)
class FoundNode:
    """A V4L2 node as sysfs describes it.

    Attributes
    ----------
    path : device node
    name : name used in the driver
    index : number of the node within its device; a UVC camera's 0 captures, 1 is metadata
    serial, port : USB serial number and port path such as ``1-2.3``; empty if it has none
    """

    path: str
    name: str
    index: int
    serial: str
    port: str


def list_nodes(dev_root: Path = DEV_ROOT, sysfs_root: Path = SYSFS_ROOT) -> tuple[FoundNode, ...]:
    """Return all V4L2 nodes there are now, in the order of their numbers."""
    found = []
    for entry in (sysfs_root / "class" / "video4linux").glob("video*"):
        device = entry / "device"  # a link to the USB interface; its parent is the USB device
        owner = device.resolve().parent if device.exists() else entry
        is_usb = (owner / "idVendor").exists()
        node = FoundNode(
            path=str(dev_root / entry.name),
            name=_read(entry / "name"),
            index=int(_read(entry / "index") or 0),
            serial=_read(owner / "serial") if is_usb else "",
            port=owner.name if is_usb else "",
        )
        found.append((int(entry.name.removeprefix("video")), node))
    return tuple(node for _, node in sorted(found, key=lambda item: item[0]))


def find_node(address: str, dev_root: Path = DEV_ROOT, sysfs_root: Path = SYSFS_ROOT) -> str:
    """Return the node to open for an address.

    Parameters
    ----------
    address : a node's path, ``unix:/path.sock``, ``serial:<USB serial>`` or ``usb:<port path>``
    dev_root, sysfs_root : mount points of nodes and sysfs

    Raises
    ------
    LinkError : no such camera is plugged in; the message lists what is
    WrongDeviceError : more than one fits
    ValueError : the address has none of the four forms, or names nothing after its prefix
    """
    if address.startswith("/") or address.startswith(UNIX_PREFIX):
        return address
    nodes = [node for node in list_nodes(dev_root, sysfs_root) if node.index == 0]
    if address.startswith(SERIAL_PREFIX):
        wanted = address.removeprefix(SERIAL_PREFIX)
        fitting = [node for node in nodes if node.serial == wanted]
    elif address.startswith(PORT_PREFIX):
        wanted = address.removeprefix(PORT_PREFIX)
        fitting = [node for node in nodes if node.port == wanted]
    else:
        raise ValueError(
            f"camera address {address!r}: a path, {UNIX_PREFIX}PATH, {SERIAL_PREFIX}SERIAL "
            f"or {PORT_PREFIX}PORT"
        )
    if not wanted:
        raise ValueError(f"camera address {address!r} names nothing")
    if not fitting:
        there = joined("; ", map(_tell, nodes)) or "none"
        raise LinkError(
            say(
                "camera {address}: not plugged in; cameras there: {there}",
                address=address,
                there=there,
            )
        )
    if len(fitting) > 1:
        raise WrongDeviceError(
            say(
                "camera {address}: {fitting_count} cameras answer to it: ",
                address=address,
                fitting_count=len(fitting),
            )
            + joined("; ", map(_tell, fitting))
        )
    return fitting[0].path


def _tell(node: FoundNode) -> str:
    return say(
        "{path} {name} serial {serial} port {port}",
        path=node.path,
        name=repr(node.name),
        serial=node.serial or "-",
        port=node.port or "-",
    )


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:  # a device without this attribute, or one that leaves while we look
        return ""
