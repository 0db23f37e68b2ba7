"""The arm's driver on a real terminal against the emulated arm: everything but the metal.

Driver and emulator share one event loop and one clock, and nothing else; the model is stepped in
world time as the emulated cell does it. A busy kernel holds bytes back on a terminal: where silence
is what is tested, driver and emulator meet on a socket instead.
"""

import asyncio
import os
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Literal

from cross_bench import HANG_WALL_S, Living, end, live, one_clock

from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.umi_scara import ArmConfig, Axis, UmiScara, WireExchange
from emulators.clock import SharedClock, WorldClock
from emulators.umi_scara import ArmErrors, ArmModel, ArmServer, ArmWire
from emulators.umi_scara import Axis as EmulatedAxis

EMULATED = {axis: EmulatedAxis[axis.name] for axis in Axis}


@dataclass
class ArmBench(Living):
    """One driver, one emulated arm, and everything that went over the line between them.

    Attributes
    ----------
    stopped_ips : IPs of the arm that have carried out a dead stop since `forget`
    """

    arm: UmiScara
    model: ArmModel
    wire: ArmWire
    server: ArmServer
    clock: CellClock
    world: SharedClock
    trace: list[WireExchange] = field(default_factory=list)
    lived_s: float = 0.0
    stopped_ips: set[int] = field(default_factory=set)
    on_exchange: Callable[[WireExchange], None] | None = None
    _heard: asyncio.Event = field(default_factory=asyncio.Event)
    _lived: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        stop = self.model.stop

        def note(ip: int, ramp: bool) -> None:
            if not ramp:
                self.stopped_ips.add(ip)
            stop(ip, ramp)

        self.model.stop = note  # type: ignore[method-assign]

    def forget(self) -> None:
        """Forget what went over the line, and which IPs were stopped."""
        self.trace.clear()
        self.stopped_ips.clear()

    def advance(self, dt_s: float) -> None:
        """Let time pass for the arm [world s]."""
        self.model.advance(dt_s)
        self.lived_s += dt_s
        self._lived.set()

    def hear(self, exchange: WireExchange) -> None:
        self.trace.append(exchange)
        self._heard.set()
        if self.on_exchange is not None:
            self.on_exchange(exchange)

    async def exchanged(self, is_it: Callable[[WireExchange], bool]) -> None:
        """Wait for an exchange that is yet to come."""
        seen_count = len(self.trace)
        async with asyncio.timeout(HANG_WALL_S):
            while not any(is_it(exchange) for exchange in self.trace[seen_count:]):
                self._heard.clear()
                await self._heard.wait()

    async def moving(self) -> None:
        """Wait until the driver has seen an axis move."""
        await self.exchanged(
            lambda x: (
                x.request[0] in range(0x10, 0x18) and len(x.reply) == 3 and bool(x.reply[1] & 1)
            )
        )

    async def homed(self) -> "ArmBench":
        await self.arm.connect()
        await self.arm.enable_power()
        await self.arm.home()
        self.forget()
        return self

    async def as_if_homed(self) -> "ArmBench":
        """Connect to an arm that stands at its park, counters true, and believe them.

        Homing takes a second and has its own tests.
        """
        self.model.place(dict.fromkeys(EmulatedAxis, 0.0) | {EmulatedAxis.ZED: -18.0})
        self.wire.run_warm()
        await self.arm.connect()
        await self.arm.enable_power()
        self.model.reference()
        self.arm.positions.is_homed = True
        self.arm.positions.dead_bands = dict.fromkeys(Axis, 2)
        self.forget()
        return self

    async def pass_time(self, duration_s: float) -> None:
        """Wait until so much time has passed for the arm, whatever the clock says [world s].

        A pause of the host is time that the arm has not lived through (see `live`).
        """
        until_s = self.lived_s + duration_s
        while self.lived_s < until_s:
            self._lived.clear()
            await self._lived.wait()

    def true_counts(self) -> dict[Axis, float]:
        """Return where the axes truly are, which no byte tells [counts]."""
        return {axis: self.model.axes[EMULATED[axis]].position for axis in Axis}

    def refused(self) -> list[WireExchange]:
        """Return the exchanges that ended with a code that means a mistake of the host."""
        return [x for x in self.trace if len(x.reply) == 1 and 0x05 <= x.reply[0] <= 0x0D]


class SocketArmServer(ArmServer):
    """The arm's end of a socket instead of a terminal."""

    def __init__(self, wire: ArmWire, clock: WorldClock) -> None:
        super().__init__(wire, clock)
        self.host_end, self._arm_end = socket.socketpair()

    async def start(self) -> None:
        self.host_end.setblocking(False)
        self._arm_end.setblocking(False)
        self._master_fd, self._slave_fd = self._arm_end.detach(), os.open(os.devnull, os.O_RDONLY)
        self._slave_name = "a socket"
        asyncio.get_running_loop().add_reader(self._master_fd, self._on_readable)

    async def aclose(self) -> None:
        await super().aclose()
        self.host_end.close()


class SocketTransport:
    """The host's end of that socket, which stays open for the next connection."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    def write(self, data: bytes) -> None:
        assert self._end.send(data) == len(data)

    async def read(self, timeout_wall_s: float) -> bytes:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(0)
        try:
            return self._end.recv(4096)
        except BlockingIOError:
            if timeout_wall_s <= 0:
                return b""
        readable = asyncio.Event()
        loop.add_reader(self._end, readable.set)
        try:
            async with asyncio.timeout(timeout_wall_s):
                await readable.wait()
            return self._end.recv(4096)
        except TimeoutError:
            return b""
        finally:
            loop.remove_reader(self._end)

    async def aclose(self) -> None:
        pass


@asynccontextmanager
async def arm_bench(
    *,
    speed: float = 30.0,
    seed: int = 0,
    listening: int = 0,
    strict: bool = False,
    config: ArmConfig | None = None,
    line: Literal["terminal", "socket"] = "terminal",
    errors: ArmErrors | None = None,
) -> AsyncIterator[ArmBench]:
    """Start an arm that was just switched on, and a driver that has not connected yet."""
    async with (
        one_clock(speed) as (world, clock),
        _arm_bench(world, clock, seed, listening, strict, config, line, errors) as bench,
    ):
        yield bench


@asynccontextmanager
async def _arm_bench(
    world: SharedClock,
    clock: CellClock,
    seed: int,
    listening: int,
    strict: bool,
    config: ArmConfig | None,
    line: Literal["terminal", "socket"],
    errors: ArmErrors | None,
) -> AsyncIterator[ArmBench]:
    model = ArmModel(seed, errors or ArmErrors())
    wire = ArmWire(model, strict=strict, listening=listening)
    server = ArmServer(wire, world) if line == "terminal" else SocketArmServer(wire, world)
    await server.start()
    benches: list[ArmBench] = []
    arm = UmiScara(
        (lambda: SocketTransport(server.host_end))
        if isinstance(server, SocketArmServer)
        else str(server.path),
        config=config,
        clock=clock,
        trace=lambda x: benches[0].hear(x),
    )
    benches.append(ArmBench(arm, model, wire, server, clock, world))
    living = asyncio.create_task(live(benches[0]))
    try:
        yield benches[0]
    finally:
        with suppress(DeviceError):  # a test may have broken the arm for good
            await arm.aclose()
        await end(living)
        await server.aclose()
