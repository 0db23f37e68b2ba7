"""Gripper, lamps and I/O block behind their wires, and a link to each: everything but the metal."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from cross_bench import Living, end, live, one_clock

from drivers.clock import CellClock
from drivers.modbus_link import (
    Address,
    ModbusLink,
    RtuAddress,
    RtuOverTcpAddress,
    TcpAddress,
)
from emulators.clock import SharedClock, WorldClock
from emulators.modbus import (
    Bus,
    BusReply,
    ModbusDevice,
    RtuOverTcpServer,
    RtuPtyServer,
    Steppable,
    TcpGateway,
    TcpServer,
)

Transport = Literal["tcp", "rtu", "rtu-tcp", "block"]
REPLY_TIMEOUT_S = 0.3


class WatchedBus(Bus):
    """A bus that tells of each request before it is carried out."""

    before_request: Callable[[], None] | None = None

    def request(self, unit: int, pdu: bytes, now_s: float) -> BusReply | None:
        if self.before_request is not None:
            self.before_request()
        return super().request(unit, pdu, now_s)


@dataclass
class ModbusBench(Living):
    """One line with devices on it, served and linked to.

    Attributes
    ----------
    trace : (sending, bytes) of everything that crossed the wire, as the driver saw it
    """

    bus: WatchedBus
    server: TcpGateway | RtuPtyServer | RtuOverTcpServer | TcpServer
    link: ModbusLink
    world: SharedClock
    clock: CellClock
    steppable: Sequence[Steppable]
    trace: list[tuple[bool, bytes]] = field(default_factory=list)
    lived_s: float = 0.0

    def advance(self, dt_s: float) -> None:
        # no longer than the world's own step, or a jaw would jump past what it meets
        for _ in range(count := max(1, round(dt_s * 240))):
            for device in self.steppable:
                device.advance(dt_s / count)
        self.lived_s += dt_s

    async def pass_time(self, duration_s: float) -> None:
        """Let world time pass [world s]."""
        until_s = self.lived_s + duration_s
        while self.lived_s < until_s:
            await self.world.sleep(until_s - self.lived_s)

    @property
    def patience_s(self) -> float:
        """How long the driver waits for a reply [cell s]."""
        return self.clock.patience_s(REPLY_TIMEOUT_S)

    def sent(self) -> list[bytes]:
        """Return all frames the driver has sent."""
        return [data for sending, data in self.trace if sending]


def _server(
    transport: Transport, bus: Bus, world: WorldClock, baudrate: int, folder: Path
) -> TcpGateway | RtuPtyServer | RtuOverTcpServer | TcpServer:
    match transport:
        case "tcp":
            return TcpGateway(bus, world, baudrate=baudrate)
        case "rtu":
            return RtuPtyServer(bus, world, baudrate, link=folder / "line")
        case "rtu-tcp":
            return RtuOverTcpServer(bus, world, baudrate=baudrate)
        case "block":
            return TcpServer(bus, world)


def _address(
    server: TcpGateway | RtuPtyServer | RtuOverTcpServer | TcpServer, baudrate: int
) -> Address:
    if isinstance(server, RtuPtyServer):
        return RtuAddress(server.path, baudrate)
    if isinstance(server, RtuOverTcpServer):
        return RtuOverTcpAddress(*server.address)
    return TcpAddress(*server.address)


@asynccontextmanager
async def modbus_bench(
    transport: Transport,
    devices: Sequence[ModbusDevice],
    steppable: Sequence[Steppable],
    folder: Path,
    *,
    baudrate: int = 115_200,
    speed: float = 20.0,
) -> AsyncIterator[ModbusBench]:
    """Serve devices on one line and link to it; nothing has been asked yet.

    Parameters
    ----------
    transport : "tcp" a gateway to a serial line, "rtu" a terminal, "rtu-tcp" RTU frames over TCP,
        "block" a device with a network plug of its own
    """
    bus = WatchedBus(devices)
    async with AsyncExitStack() as stack:
        world, clock = await stack.enter_async_context(one_clock(speed))
        server = _server(transport, bus, world, baudrate, folder)
        await server.start()
        stack.push_async_callback(server.aclose)
        trace: list[tuple[bool, bytes]] = []
        link = ModbusLink(
            _address(server, baudrate),
            clock,
            reply_timeout_s=REPLY_TIMEOUT_S,
            trace=lambda sending, data: trace.append((sending, data)),
        )
        stack.push_async_callback(link.aclose)
        bench = ModbusBench(bus, server, link, world, clock, steppable, trace)
        living = asyncio.create_task(live(bench))
        stack.push_async_callback(end, living)
        yield bench
