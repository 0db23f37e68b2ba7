"""Byte queues in place of sockets and of the arm's serial line.

A connection has two ends; what one writes, the other's protocol gets a moment later, in order. An
end belongs to the process that opened it. When that process is killed, its end is cut: what it had
written before still arrives, the other end sees the connection close.
"""

import asyncio
import contextvars
import random
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, cast

from drivers.errors import UnpluggedError
from emulators.umi_scara import ArmWire

if TYPE_CHECKING:
    from .loop import SimulatedLoop, SimulatedProcess

MIN_LATENCY_S: Final = 0.000_05
MAX_LATENCY_S: Final = 0.000_4  # a loaded computer's loopback
FIRST_PORT: Final = 20_000
ADAPTER_S: Final = 0.003  # a USB adapter collects a reply's bytes before it hands them over

Address = tuple[str, int]
Factory = Callable[[], asyncio.BaseProtocol]


class _End(asyncio.Transport):
    """One end of a connection."""

    def __init__(self, ports: "Ports", address: Address, owner: "SimulatedProcess | None") -> None:
        super().__init__({"peername": address, "sockname": address, "socket": None})
        self._ports = ports
        self.owner = owner
        self.other: _End | None = None
        self._protocol: asyncio.BaseProtocol | None = None
        self._context = contextvars.copy_context()
        self._is_closing = False
        self._due_s = 0.0  # of the last bytes on their way to this end

    def attach(self, protocol: asyncio.BaseProtocol, context: contextvars.Context) -> None:
        """Hand what arrives to a protocol, in its own context."""
        self._protocol, self._context = protocol, context
        context.run(protocol.connection_made, self)

    # --- as asyncio's transports ----------------------------------------------------------------

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send; data for a closed or cut end is lost."""
        if self._is_closing or self.other is None or not data:
            return
        self.other.deliver(bytes(data))

    def close(self) -> None:
        """Close; the other end sees it after the data sent before."""
        self._close(None)

    def abort(self) -> None:
        """Reset the connection."""
        self._close(None)

    def is_closing(self) -> bool:
        """Return whether the end takes no more data."""
        return self._is_closing

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Hand what arrives to another protocol."""
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Return the protocol."""
        assert self._protocol is not None
        return self._protocol

    def pause_reading(self) -> None:
        """Flow control is not needed: queues are short."""

    def resume_reading(self) -> None:
        """Pause; see `pause_reading`."""

    def get_write_buffer_size(self) -> int:
        """Return 0: all data is on its way."""
        return 0

    def can_write_eof(self) -> bool:
        """Return False: no half-closed connections here."""
        return False

    # --- the way of the bytes -------------------------------------------------------------------

    def deliver(self, data: bytes) -> None:
        """Let bytes arrive here a moment later, after data already on its way."""
        self._later(self._arrive, data)

    def cut(self) -> None:
        """End this end at once, silently here; the other end sees the connection close."""
        self._is_closing = True
        if self.other is not None:
            self.other.lose()

    def _later(self, what: Callable[..., None], *args: Any) -> None:  # noqa: ANN401
        loop = self._ports.loop
        self._due_s = max(self._due_s, loop.time() + self._ports.latency_s())
        loop.call_at(self._due_s, what, *args, context=self._context)

    def _arrive(self, data: bytes) -> None:
        if not self._is_closing:
            # pymodbus' protocols have the methods, and not the base class
            self._protocol.data_received(data)  # type: ignore[union-attr]

    def lose(self) -> None:
        """See the connection close, after data on its way."""
        self._later(self._close, None)

    def _close(self, error: Exception | None) -> None:
        if self._is_closing:
            return
        self._is_closing = True
        self._ports.forget(self)
        if self._protocol is not None:
            self._ports.loop.call_soon(self._protocol.connection_lost, error, context=self._context)
        if self.other is not None:
            self.other.lose()


class _Socket:
    """A server's view of its socket."""

    def __init__(self, address: Address) -> None:
        self._address = address

    def getsockname(self) -> Address:
        """Return host and port."""
        return self._address


class _Listener:
    """A server; a stand-in for `asyncio.Server`."""

    def __init__(self, ports: "Ports", address: Address, factory: Factory) -> None:
        self._ports = ports
        self.address = address
        self.factory = factory
        self.context = contextvars.copy_context()
        self.owner = ports.loop.owner()
        self.sockets = (_Socket(address),)

    def get_loop(self) -> asyncio.AbstractEventLoop:
        """Return the loop on which it listens."""
        return self._ports.loop

    def close(self) -> None:
        """Listen no more; open connections stay."""
        self._ports.listeners.pop(self.address, None)

    def is_serving(self) -> bool:
        """Return whether it listens."""
        return self._ports.listeners.get(self.address) is self

    async def start_serving(self) -> None:
        """Do nothing: it listens from the beginning."""

    async def wait_closed(self) -> None:
        """Nothing is left to wait for."""

    async def __aenter__(self) -> "_Listener":
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()


class Ports:
    """All listeners and connections of one loop.

    Parameters
    ----------
    loop : loop that delivers
    rng : draws how long bytes are on their way
    """

    def __init__(self, loop: "SimulatedLoop", rng: random.Random) -> None:
        self.loop = loop
        self._rng = rng
        self.listeners: dict[Address, _Listener] = {}
        self._ends: dict[int, _End] = {}
        self._next_port = FIRST_PORT

    def latency_s(self) -> float:
        """Return the latency of bytes [s]."""
        return self._rng.uniform(MIN_LATENCY_S, MAX_LATENCY_S)

    def listen(
        self, factory: Factory, host: str, port: int, *, is_unix: bool = False
    ) -> asyncio.AbstractServer:
        """Return a server that listens; OSError if the port is taken."""
        if not port and not is_unix:
            self._next_port += 1
            port = self._next_port
        if (host, port) in self.listeners:
            raise OSError(98, f"{host}:{port} is taken")
        listener = self.listeners[host, port] = _Listener(self, (host, port), factory)
        return cast(asyncio.AbstractServer, listener)

    async def connect(
        self, factory: Factory, address: Address
    ) -> tuple[_End, asyncio.BaseProtocol]:
        """Return this end's transport and protocol once the other side has accepted."""
        await asyncio.sleep(self.latency_s())
        listener = self.listeners.get(address)
        if listener is None:
            raise ConnectionRefusedError(111, "Connection refused")
        here = _End(self, address, self.loop.owner())
        there = _End(self, address, listener.owner)
        here.other, there.other = there, here
        for end in (here, there):
            self._ends[id(end)] = end
        there.attach(listener.context.run(listener.factory), listener.context)
        protocol = factory()
        here.attach(protocol, contextvars.copy_context())
        return here, protocol

    def forget(self, end: _End) -> None:
        """Drop an end that is closed."""
        self._ends.pop(id(end), None)

    def cut(self, process: "SimulatedProcess") -> None:
        """Cut all ends of a process, and close its listeners."""
        for end in [end for end in self._ends.values() if end.owner is process]:
            self.forget(end)
            end.cut()
        for listener in [one for one in self.listeners.values() if one.owner is process]:
            listener.close()


class ArmLine:
    """The arm's serial line: one user at a time, bytes at 9600 baud, as the emulated line has it.

    Parameters
    ----------
    wire : the arm's end
    loop : loop whose time it keeps
    now_s : world time
    """

    def __init__(self, wire: ArmWire, loop: "SimulatedLoop", now_s: Callable[[], float]) -> None:
        self.wire = wire
        self._loop = loop
        self._now_s = now_s
        self._user: ArmTransport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._context = contextvars.copy_context()
        self.before_request: Callable[[], None] = lambda: None

    def open(self) -> "ArmTransport":
        """Return the host's end; an earlier one gets nothing any more."""
        self._user = ArmTransport(self, self._loop.owner())
        return self._user

    def send(self, user: "ArmTransport", data: bytes) -> None:
        """Put bytes on the line, if they come from whom it belongs to."""
        if user is not self._user or (user.owner is not None and not user.owner.is_alive):
            return
        self.before_request()
        self.wire.feed(data, self._now_s())
        self._schedule()

    def _schedule(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        due_s = self.wire.next_due_s()
        if due_s is not None:
            wait_s = max(0.0, due_s - self._now_s()) + ADAPTER_S
            self._timer = self._loop.call_later(wait_s, self._hand_over, context=self._context)

    def _hand_over(self) -> None:
        self._timer = None
        data = self.wire.due(self._now_s())
        if data and self._user is not None:
            self._user.arrive(data)
        self._schedule()


def _wake(waiter: "asyncio.Future[None]") -> None:
    if not waiter.done():
        waiter.set_result(None)


class ArmTransport:
    """The host's end of the arm's line, as `drivers.umi_scara.Transport`."""

    def __init__(self, line: ArmLine, owner: "SimulatedProcess | None") -> None:
        self._line = line
        self.owner = owner
        self._buffer = bytearray()
        self._waiter: asyncio.Future[None] | None = None
        self._is_closed = False

    def arrive(self, data: bytes) -> None:
        """Take in bytes of the arm."""
        self._buffer += data
        if self._waiter is not None:
            _wake(self._waiter)

    def write(self, data: bytes) -> None:
        """Send all bytes.

        Raises
        ------
        UnpluggedError : the line is closed
        """
        if self._is_closed:
            raise UnpluggedError("arm: the line is closed")
        self._line.send(self, data)

    async def read(self, timeout_wall_s: float) -> bytes:
        """Return the bytes received, after waiting [s] for a first one; b"" if none came.

        Raises
        ------
        UnpluggedError : the line is closed
        """
        if self._is_closed:
            raise UnpluggedError("arm: the line is closed")
        if not self._buffer and timeout_wall_s > 0:
            loop = asyncio.get_running_loop()
            self._waiter = waiter = loop.create_future()
            timer = loop.call_later(timeout_wall_s, _wake, waiter)
            try:
                await waiter
            finally:
                timer.cancel()
                self._waiter = None
        data = bytes(self._buffer)
        self._buffer.clear()
        return data

    async def aclose(self) -> None:
        """Release the line."""
        self._is_closed = True
