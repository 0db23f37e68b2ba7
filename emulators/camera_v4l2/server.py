"""All cameras of a cell on their wires: FUSE nodes if possible, else sockets."""

import asyncio
import contextlib
import errno
import fcntl
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, Self

from .device import V4l2Device
from .kernel import abi
from .wires import FuseMount, SocketCamera, can_mount

_SELF_TEST_TIMEOUT_S: Final = 30.0  # a hang, not a busy machine


class CameraServer:
    """Owns the wires of some cameras.

    Parameters
    ----------
    devices : cameras by the names of their nodes, video0 and so on
    directory : a directory of their own, for the nodes or sockets
    transport : "auto" takes FUSE where it can be mounted, else sockets

    Attributes
    ----------
    transport : "fuse" or "socket", once started
    why_not_fuse : the reason for sockets; None with FUSE, or if sockets were asked for
    """

    def __init__(
        self,
        devices: Mapping[str, V4l2Device],
        directory: Path,
        transport: Literal["auto", "fuse", "socket"] = "auto",
    ) -> None:
        """Prepare to serve `devices` under their names (video0 ...) in a directory of their own."""
        self._devices = dict(devices)
        self._directory = directory
        self._asked: Final = transport
        self.transport: Literal["fuse", "socket"] | None = None
        self.why_not_fuse: str | None = None
        self._mount: FuseMount | None = None
        self._sockets: dict[str, SocketCamera] = {}
        self._retired: list[SocketCamera] = []
        self._node_names: dict[str, str] = {}  # device -> the name it has on the wire at present
        self._addresses: dict[str, str] = {}
        self._failed = asyncio.Event()

    @property
    def addresses(self) -> Mapping[str, str]:
        """The address of each plugged camera: a path, or `unix:` and the path of a socket."""
        return MappingProxyType(self._addresses)

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def start(self) -> None:
        """Open the wires.

        Raises
        ------
        OSError : FUSE was asked for and cannot be had, or the directory cannot be used
        """
        if self._asked != "socket":
            self.why_not_fuse = await asyncio.to_thread(can_mount)
            if self.why_not_fuse is None:
                self.why_not_fuse = await self._start_fuse()
            if self.why_not_fuse is None:
                self.transport = "fuse"
                return
            if self._asked == "fuse":
                raise OSError(errno.EPERM, self.why_not_fuse, str(self._directory))
        self._directory.mkdir(parents=True, exist_ok=True)
        self.transport = "socket"
        for name in self._devices:
            self._show(name, name)

    async def _start_fuse(self) -> str | None:
        """Mount and try it; return why it does not work, with nothing left behind, or None."""
        loop = asyncio.get_running_loop()

        def fail() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed, nobody asks any more
                loop.call_soon_threadsafe(self._failed.set)

        self._mount = FuseMount(self._directory, fail)
        try:
            self._mount.open()
            for name in self._devices:
                self._show(name, name)
            async with asyncio.timeout(_SELF_TEST_TIMEOUT_S):
                for address in self._addresses.values():
                    await asyncio.to_thread(query_node, address)
        except OSError as error:  # TimeoutError is one: some sandboxes mount, and pass no ioctl
            reason = f"FUSE mounts, but does not serve: {error or type(error).__name__}"
            self._addresses.clear()
            self._node_names.clear()
            self._mount.close()
            self._mount = None
            return reason
        return None

    async def run(self) -> None:
        """Let every camera take its frames, until cancelled.

        Raises
        ------
        ExceptionGroup : a picture source raised, or the mount had to be given up
        ConnectionAbortedError : in that group, the mount had to be given up
        """
        async with asyncio.TaskGroup() as tasks:
            for device in self._devices.values():
                tasks.create_task(device.run())
            await self._failed.wait()
            raise ConnectionAbortedError(f"the camera mount {self._directory} was given up")

    def unplug(self, name: str) -> None:
        """Unplug a camera and remove its name."""
        node_name = self._node_names.pop(name)
        del self._addresses[name]
        self._devices[name].unplug()
        if self._mount is not None:
            self._mount.remove(node_name)
        else:
            retired = self._sockets.pop(node_name)
            retired.retire()
            self._retired.append(retired)

    def plug(self, name: str, node_name: str | None = None) -> str:
        """Put an unplugged camera back, under another name if one is given; return its address.

        Raises
        ------
        ValueError : the camera is plugged in, or another one has the name
        """
        node_name = node_name or name
        if name in self._node_names or node_name in self._node_names.values():
            raise ValueError(f"{name} cannot become {node_name}: there is one already")
        self._devices[name].plug()
        return self._show(name, node_name)

    async def aclose(self) -> None:
        """Close the wires and hang up on every client."""
        self._addresses.clear()
        self._node_names.clear()
        mount, self._mount = self._mount, None
        if mount is not None:
            await asyncio.to_thread(mount.close)
        for camera in [*self._sockets.values(), *self._retired]:
            await asyncio.to_thread(camera.close)
        self._sockets.clear()
        self._retired.clear()

    def _show(self, name: str, node_name: str) -> str:
        device = self._devices[name]
        if self._mount is not None:
            address = str(self._mount.add(node_name, device))
        else:
            camera = SocketCamera(device, self._directory / f"{node_name}.sock")
            camera.open()
            self._sockets[node_name] = camera
            address = f"unix:{camera.path}"
        self._node_names[name] = node_name
        self._addresses[name] = address
        return address


def query_node(path: str) -> None:
    """Query a node's capabilities as a client would, which raises OSError if it has none.

    Safe in the server's own process, which a mapping would not be: opening, asking (into a
    bytearray) and closing all let go of the interpreter's lock.
    """
    fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.ioctl(fd, abi.Request.QUERYCAP, bytearray(abi.CAPABILITY.size))
    finally:
        os.close(fd)
