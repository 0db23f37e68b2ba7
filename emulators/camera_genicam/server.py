"""All GigE Vision cameras of a cell on their sockets, each at an address of its own on loopback.

Pictures leave no faster than a Gigabit Ethernet carries them: a burst would overrun the client's
socket, which no real camera does.
"""

import asyncio
import contextlib
import ipaddress
import logging
import socket
import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, Self

from .device import Clock, GenicamDevice, Peer
from .device.device import LINK_MBIT_PER_S
from .protocol import gvcp, gvsp
from .protocol.gvcp import Command

log = logging.getLogger(__name__)

_FIRST_ADDRESS: Final = int(ipaddress.IPv4Address("127.0.0.2"))
_ADDRESS_COUNT: Final = 2000  # addresses that are tried for a camera
_EVERYWHERE: Final = "255.255.255.255"
_LINK_BYTES_PER_S: Final = LINK_MBIT_PER_S * 1e6 / 8.0
# A socket of Linux takes 212 992 bytes unless its owner asks for more, bookkeeping included, which
# is as much again: half of it, so that the client has the other half to read in.
_BURST_BYTES: Final = 53_248
_PAUSE_WALL_S: Final = 0.0005


class GenicamServer:
    """Owns the sockets of some cameras.

    Parameters
    ----------
    devices : cameras by name
    clock : the world's time
    """

    def __init__(self, devices: Mapping[str, GenicamDevice], clock: Clock) -> None:
        self._clock = clock
        self._cameras = {name: _Camera(device, clock) for name, device in devices.items()}
        self._searched: asyncio.DatagramTransport | None = None

    @property
    def addresses(self) -> Mapping[str, str]:
        """The IP address of each plugged camera; the port is `gvcp.PORT`."""
        return MappingProxyType(
            {name: one.host for name, one in self._cameras.items() if one.device.is_plugged}
        )

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def start(self) -> None:
        """Open the sockets.

        Raises
        ------
        OSError : no address of loopback is free
        """
        for camera in self._cameras.values():
            await camera.open()
        loop = asyncio.get_running_loop()
        try:
            searched = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            searched.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            searched.bind((_EVERYWHERE, gvcp.PORT))
            self._searched, _ = await loop.create_datagram_endpoint(
                lambda: _Discovery(self._cameras), sock=searched
            )
        except OSError as error:
            log.warning("cameras are found by their addresses alone: %s", error)

    async def run(self) -> None:
        """Let every camera take and send its pictures, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for camera in self._cameras.values():
                tasks.create_task(camera.run())

    def unplug(self, name: str) -> None:
        """Unplug a camera: it keeps its address and is silent."""
        self._cameras[name].device.unplug()

    def plug(self, name: str) -> str:
        """Put an unplugged camera back; return its address.

        Raises
        ------
        ValueError : it is plugged in
        """
        camera = self._cameras[name]
        if camera.device.is_plugged:
            raise ValueError(f"{name} is plugged in")
        camera.device.plug()
        return camera.host

    async def aclose(self) -> None:
        """Close the sockets."""
        if self._searched is not None:
            self._searched.close()
        for camera in self._cameras.values():
            camera.close()


class _Camera(asyncio.DatagramProtocol):
    """One camera's sockets: for control, and for pictures."""

    def __init__(self, device: GenicamDevice, clock: Clock) -> None:
        self.device = device
        self.host = ""
        self._clock = clock
        self._due = asyncio.Event()
        self._control: asyncio.DatagramTransport | None = None
        self._stream: socket.socket | None = None
        self._link_free_wall_s = 0.0

    async def open(self) -> None:
        """Take the first free address.

        Raises
        ------
        OSError : none is free
        """
        loop = asyncio.get_running_loop()
        control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for number in range(_FIRST_ADDRESS, _FIRST_ADDRESS + _ADDRESS_COUNT):
            self.host = str(ipaddress.IPv4Address(number))
            with contextlib.suppress(OSError):
                control.bind((self.host, gvcp.PORT))
                break
        else:
            control.close()
            raise OSError(f"no free address with port {gvcp.PORT} above 127.0.0.1")
        self._stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stream.bind((self.host, 0))
        self._stream.setblocking(False)
        self.device.connect(self.host, self._stream.getsockname()[1])
        self.device.rouse = self._due.set
        self._control, _ = await loop.create_datagram_endpoint(lambda: self, sock=control)

    def close(self) -> None:
        """Close both sockets."""
        if self._control is not None:
            self._control.close()
        if self._stream is not None:
            self._stream.close()

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Answer a request."""
        reply, again = self.device.answer(data, Peer(*addr[:2]), time.monotonic())
        if reply is not None and self._control is not None:
            self._control.sendto(reply, addr)
        for packet in (*again, *self.device.take_test_packets()):
            self._put(packet)

    def answer_search(self, request: gvcp.Request, addr: tuple[str, int]) -> None:
        """Answer a search that was sent to everybody."""
        reply = self.device.discovered(request)
        if reply is not None and self._control is not None:
            self._control.sendto(reply, addr)

    async def run(self) -> None:
        """Take and send pictures as world time passes, until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            self._due.clear()
            next_s, next_wall_s = self.device.advance(self._clock.now_s(), time.monotonic())
            while (frame := self.device.take(self._clock.now_s())) is not None:
                await self._send(self.device.packets_of(frame))
                self.device.sent(frame)
                self._due.set()
            wakes = [] if next_wall_s is None else [next_wall_s]
            if next_s is not None:
                # time may stand still: look again, but not without a pause
                soonest_wall_s = loop.time() + _PAUSE_WALL_S
                wakes.append(max(self._clock.to_monotonic_s(next_s), soonest_wall_s))
            timer = loop.call_at(min(wakes), self._due.set) if wakes else None
            try:
                await self._due.wait()
            finally:
                if timer is not None:
                    timer.cancel()

    async def _send(self, packets: Sequence[bytes]) -> None:
        """Send packets at the link's speed, with the pauses that the client asked for."""
        pause_s = self.device.packet_delay_s
        burst_s = _BURST_BYTES / _LINK_BYTES_PER_S
        for packet in packets:
            now_wall_s = time.monotonic()
            if self._link_free_wall_s > now_wall_s + burst_s:
                await asyncio.sleep(self._link_free_wall_s - now_wall_s)
            takes_s = (len(packet) + gvsp.IP_UDP_BYTES) / _LINK_BYTES_PER_S + pause_s
            self._link_free_wall_s = max(self._link_free_wall_s, time.monotonic()) + takes_s
            self._put(packet)

    def _put(self, packet: bytes) -> None:
        destination = self.device.destination
        if destination is None or self._stream is None or not self.device.passes(packet):
            return
        # nobody there (a client has died), or no room: a datagram that is lost
        with contextlib.suppress(OSError):
            self._stream.sendto(packet, destination)


class _Discovery(asyncio.DatagramProtocol):
    """Hears searches that are sent to everybody; answers those from loopback alone."""

    def __init__(self, cameras: Mapping[str, _Camera]) -> None:
        self._cameras = cameras

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Let every camera answer a search."""
        request = gvcp.read_request(data)
        if request is None or request.command != Command.DISCOVERY:
            return
        if not ipaddress.IPv4Address(addr[0]).is_loopback:
            return
        for camera in self._cameras.values():
            camera.answer_search(request, addr)
