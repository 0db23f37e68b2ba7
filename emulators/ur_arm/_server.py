"""The controller's ports: sockets, one session for each client, and what is sent by itself.

Everything is paced by the control cycles of the arm, thus by whoever lets its time pass; nothing
here looks at a clock.
"""

import asyncio
import contextlib
import logging
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import ClassVar, Final

from emulators.tcp_listener import TcpListener

from ._facts import CYCLE_S, Software
from ._model import Message, UrArm
from ._script import ScriptError, ScriptReader
from .wires import (
    GREETING,
    READ_ONLY_CODE,
    BadFrameError,
    DashboardSession,
    RtdeSession,
    UrcapSession,
    message_packet,
    realtime_packet,
    state_packet,
    version_message,
)

log = logging.getLogger(__name__)

READ_SIZE: Final = 65536
# A client that leaves more than this unread gets no further packages until it has caught up.
UNREAD_BYTES_MAX: Final = 1 << 16
STATE_CYCLES: Final = 50  # 10 Hz, universal_robots.md 4.1
POLL_CYCLES: Final = 25  # the URCap asks its gripper so often that it never feels alone


@dataclass(frozen=True, slots=True)
class Ports:
    """The ports that are served; 0 for any free one."""

    dashboard: int = 0
    primary: int = 0
    secondary: int = 0
    realtime: int = 0
    rtde: int = 0
    urcap: int = 0


STANDARD_PORTS: Final = Ports(29999, 30001, 30002, 30003, 30004, 63352)


@dataclass(slots=True)
class Faults:
    """Faults of the controller's network.

    Attributes
    ----------
    unplugged : the cable is out: nothing gets through, connections stay
    late_s : delay of every RTDE data package [world s]
    lost_count : so many RTDE data packages to come are skipped; counts itself down
    """

    unplugged: bool = False
    late_s: float = 0.0
    lost_count: int = 0


class UrServer:
    """All ports of one controller.

    Parameters
    ----------
    arm : the controller
    host : address of this arm alone, where its ports are the standard ones
    ports : numbers of the ports
    software : version that it reports

    Attributes
    ----------
    faults : of the network
    """

    def __init__(
        self,
        arm: UrArm,
        host: str = "127.0.0.1",
        ports: Ports = Ports(),
        software: Software = Software(),  # noqa: B008  (frozen)
    ) -> None:
        self.arm, self.software, self.faults = arm, software, Faults()
        self._host = host
        self._is_powered = True
        taken: set[str] = set()
        self._rtde = _RtdePort(self, ports.rtde, taken)
        self._primary = _ScriptPort(self, ports.primary, tells_messages=True)
        self._secondary = _ScriptPort(self, ports.secondary)
        self._realtime = _ScriptPort(self, ports.realtime, is_realtime=True)
        self.ports: Mapping[str, TcpListener] = {
            "dashboard": _DashboardPort(self, ports.dashboard),
            "primary": self._primary,
            "secondary": self._secondary,
            "realtime": self._realtime,
            "rtde": self._rtde,
        }
        if arm.gripper is not None:
            self.ports = {**self.ports, "urcap": _UrcapPort(self, ports.urcap)}
        self._was_remote = arm.is_remote
        self._passing = asyncio.Event()
        self._passing.set()
        self._late: deque[tuple[int, asyncio.StreamWriter, bytes]] = deque()

    @property
    def host(self) -> str:
        """The address of its ports."""
        return self._host

    async def start(self) -> None:
        """Listen on all ports.

        Raises
        ------
        OSError : a port is taken, or the address is none of this machine
        """
        try:
            for port in self.ports.values():
                await port.start()
        except OSError:
            await self.aclose()
            raise
        self.arm.on_cycle.append(self._on_cycle)
        self.arm.on_message.append(self._on_message)

    async def aclose(self) -> None:
        """Close all ports and connections; may be called twice."""
        with contextlib.suppress(ValueError):
            self.arm.on_cycle.remove(self._on_cycle)
            self.arm.on_message.remove(self._on_message)
        for port in self.ports.values():
            await port.aclose()

    def announcement(self) -> dict[str, str | int]:
        """Return its address and the number of each port."""
        numbers = {name: port.address[1] for name, port in self.ports.items()}
        return {"host": self._host, **numbers}

    # --- faults -----------------------------------------------------------------------------------

    def set_faults(self, **values: float) -> None:
        """Change faults by name; the others stay.

        Raises
        ------
        KeyError : there is no such fault
        """
        known = {field.name for field in fields(Faults)}
        if unknown := set(values) - known:
            raise KeyError(f"{', '.join(sorted(unknown))}: none of {', '.join(sorted(known))}")
        for name, value in values.items():
            setattr(self.faults, name, value)
        if self.faults.unplugged:
            self._passing.clear()
        else:
            self._passing.set()

    @property
    def is_powered(self) -> bool:
        """Whether the controller has its supply."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        if is_powered == self._is_powered:
            return
        self._is_powered = is_powered
        self.arm.restart()
        for port in self.ports.values():
            port.is_reachable = is_powered
            port.drop_connections()

    async def wait_for_cable(self) -> None:
        """Return once the cable is in."""
        await self._passing.wait()

    # --- what is sent by itself -------------------------------------------------------------------

    def _on_cycle(self) -> None:
        arm = self.arm
        if arm.gripper is not None and arm.cycle_count % POLL_CYCLES == 0:
            arm.gripper.request(bytes.fromhex("03 07D0 0003"), 0.0)
        if self._was_remote and not arm.is_remote:
            for port in (self._primary, self._secondary, self._realtime):
                port.drop_connections()
        self._was_remote = arm.is_remote
        if self.faults.unplugged:
            return
        while self._late and self._late[0][0] <= arm.cycle_count:
            _, writer, data = self._late.popleft()
            push(writer, data)
        self._stream_rtde()
        if arm.cycle_count % STATE_CYCLES == 0:
            for port in (self._primary, self._secondary):
                if port.writers:
                    packet = state_packet(arm, self.software)
                    for writer in port.writers:
                        push(writer, packet)
        if self._realtime.writers:
            packet = realtime_packet(arm, self.software)
            for writer in self._realtime.writers:
                push(writer, packet)

    def _stream_rtde(self) -> None:
        late = round(self.faults.late_s / CYCLE_S)
        for writer, session in self._rtde.sessions.items():
            data = session.due()
            if not data:
                continue
            if self.faults.lost_count > 0:
                self.faults.lost_count -= 1
            elif late > 0 or self._late:
                self._late.append((self.arm.cycle_count + late, writer, data))
            else:
                push(writer, data)

    def _on_message(self, message: Message) -> None:
        log.info("arm: %s", message.text)
        if not self.faults.unplugged:
            for writer in self._primary.writers:
                push(writer, message_packet(self.arm, message))


def push(writer: asyncio.StreamWriter, data: bytes) -> None:
    """Send something nobody has asked for; to a client that does not read it, nothing."""
    transport = writer.transport
    if not transport.is_closing() and transport.get_write_buffer_size() < UNREAD_BYTES_MAX:
        writer.write(data)


class _Port(TcpListener):
    ended_by: ClassVar[tuple[type[Exception], ...]] = (ConnectionError, BadFrameError)

    def __init__(self, server: UrServer, port: int) -> None:
        super().__init__(server.host, port)
        self.server = server

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self.server.wait_for_cable()
        await self._talk(reader, writer)

    @abstractmethod
    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client, whose cable is in."""

    async def read(self, reader: asyncio.StreamReader) -> bytes:
        """Return what comes next; nothing comes while the cable is out."""
        data = await reader.read(READ_SIZE)
        await self.server.wait_for_cable()
        return data


class _RtdePort(_Port):
    def __init__(self, server: UrServer, port: int, taken: set[str]) -> None:
        super().__init__(server, port)
        self._taken = taken
        self.sessions: dict[asyncio.StreamWriter, RtdeSession] = {}

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = RtdeSession(self.server.arm, self.server.software, self._taken)
        self.sessions[writer] = session
        try:
            while data := await self.read(reader):
                writer.write(session.feed(data))
                await writer.drain()
        finally:
            del self.sessions[writer]
            session.close()


class _DashboardPort(_Port):
    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = DashboardSession(self.server.arm, self.server.software)
        writer.write(f"{GREETING}\n".encode())
        while not session.has_quit and (data := await self.read(reader)):
            writer.write(session.feed(data))
            await writer.drain()


class _ScriptPort(_Port):
    def __init__(
        self,
        server: UrServer,
        port: int,
        *,
        tells_messages: bool = False,
        is_realtime: bool = False,
    ) -> None:
        super().__init__(server, port)
        self._tells_messages, self._is_realtime = tells_messages, is_realtime
        self.writers: set[asyncio.StreamWriter] = set()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        server, scripts = self.server, ScriptReader()
        may_write = server.arm.is_remote
        if not self._is_realtime:
            writer.write(version_message(server.arm, server.software))
            writer.write(state_packet(server.arm, server.software, is_first=True))
        self.writers.add(writer)
        try:
            while data := await self.read(reader):
                for program in scripts.feed(data):
                    if not may_write:
                        self._refuse_to_write(writer)
                    elif isinstance(program, ScriptError):
                        server.arm.say(Message(program.text, program.line, program.column))
                    elif why := server.arm.start(program):
                        server.arm.say(Message(why))
        finally:
            self.writers.discard(writer)

    def _refuse_to_write(self, writer: asyncio.StreamWriter) -> None:
        """Tell a client whose connection was made in local mode that it may only read."""
        if self._tells_messages:
            message = Message("connection is read only", code=READ_ONLY_CODE)
            push(writer, message_packet(self.server.arm, message))


class _UrcapPort(_Port):
    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        gripper = self.server.arm.gripper
        assert gripper is not None  # this port is opened for one
        session = UrcapSession(gripper)
        while data := await self.read(reader):
            for reply in session.feed(data):
                writer.write(reply)
            await writer.drain()
