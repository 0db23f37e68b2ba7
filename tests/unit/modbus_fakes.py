"""Hand-written other ends of a Modbus wire for the drivers' tests: bytes in, bytes out.

Nothing here comes from pymodbus or from the drivers: the frames are built from the Modbus
application protocol V1.1b3 and the serial line guide V1.02.
"""

from __future__ import annotations

import asyncio
import os
import tomllib
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

GOLDEN = tomllib.loads(
    (Path(__file__).parent.parent / "golden" / "modbus_devices.toml").read_text()
)["frame"]


def golden(device: str, name: str) -> tuple[bytes, bytes]:
    """Return (request, reply) of a worked frame; the empty bytes for a missing one."""
    (frame,) = [f for f in GOLDEN if f["device"] == device and f["name"] == name]
    return bytes.fromhex(frame.get("request", "")), bytes.fromhex(frame.get("reply", ""))


def crc(data: bytes) -> bytes:
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


def words(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "big") for value in values)


@dataclass
class Map:
    """A device's registers; whatever is not in a dict does not exist (exception 02)."""

    holding: dict[int, int] = field(default_factory=dict)
    inputs: dict[int, int] = field(default_factory=dict)
    coils: dict[int, bool] = field(default_factory=dict)
    discrete: dict[int, bool] = field(default_factory=dict)
    functions: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 15, 16)
    on_access: Callable[[], None] = lambda: None

    def answer(self, pdu: bytes) -> bytes | None:
        function = pdu[0]
        if function not in self.functions:
            return bytes([function | 0x80, 1])
        address = int.from_bytes(pdu[1:3], "big")
        self.on_access()
        try:
            return self._answer(function, address, pdu)
        except KeyError:
            return bytes([function | 0x80, 2])

    def _answer(self, function: int, address: int, pdu: bytes) -> bytes:
        count = int.from_bytes(pdu[3:5], "big")
        if function in (1, 2):
            area = self.coils if function == 1 else self.discrete
            bits = [area[address + i] for i in range(count)]
            value = sum(1 << i for i, bit in enumerate(bits) if bit)
            size = (count + 7) // 8
            return bytes([function, size]) + value.to_bytes(size, "little")
        if function in (3, 4):
            registers = self.holding if function == 3 else self.inputs
            data = words(*(registers[address + i] for i in range(count)))
            return bytes([function, len(data)]) + data
        if function == 5:
            self._write(self.coils, address, [count == 0xFF00])
            return pdu
        if function == 6:
            self._write(self.holding, address, [count])
            return pdu
        if function == 15:
            packed = int.from_bytes(pdu[6:], "little")
            self._write(self.coils, address, [bool(packed >> i & 1) for i in range(count)])
        else:
            values = [int.from_bytes(pdu[6 + 2 * i : 8 + 2 * i], "big") for i in range(count)]
            self._write(self.holding, address, values)
        return pdu[:5]

    def _write(self, area: dict[int, Any], address: int, values: list[Any]) -> None:
        for i in range(len(values)):
            area[address + i]  # a KeyError before anything is written
        for i, value in enumerate(values):
            area[address + i] = value
        self.on_access()


@dataclass
class Bus:
    """The units behind one wire and what goes wrong on it.

    ``troubles`` are taken one per request: None (all well), "silent", "drop" (cut the
    connection), an int (exception of that code), or an Event: the reply, and those behind it,
    leave only when it is set. A device answers in the order it was asked.
    """

    units: dict[int, Callable[[bytes], bytes | None]] = field(default_factory=dict)
    troubles: list[str | int | asyncio.Event | None] = field(default_factory=list)
    silent_units: set[int] = field(default_factory=set)
    gateway_code: int | None = None  # what a gateway says for a unit that does not exist
    requests: list[bytes] = field(default_factory=list)
    connection_count: int = 0
    held: list[asyncio.Task[None]] = field(default_factory=list)
    cut: Callable[[], None] = lambda: None
    raw_write: Callable[[bytes], object] = lambda data: None

    def sent_to(self, unit: int) -> list[bytes]:
        """Return the RTU requests to one slave."""
        return [frame for frame in self.requests if frame[0] == unit]

    async def serve(
        self, unit: int, pdu: bytes, send: Callable[[bytes], None], cut: Callable[[], None]
    ) -> None:
        trouble = self.troubles.pop(0) if self.troubles else None
        if trouble == "drop":
            cut()
            return
        if unit in self.silent_units:
            return
        if isinstance(trouble, int):
            send(bytes([pdu[0] | 0x80, trouble]))
            return
        if unit not in self.units:
            if self.gateway_code is not None:
                send(bytes([pdu[0] | 0x80, self.gateway_code]))
            return
        reply = self.units[unit](pdu)
        if reply is None or trouble == "silent":
            return
        ahead = [task for task in self.held if not task.done()]
        if isinstance(trouble, asyncio.Event) or ahead:
            self.held.append(asyncio.create_task(self._late(trouble, ahead, reply, send)))
            return
        send(reply)

    async def _late(
        self,
        released: object,
        ahead: list[asyncio.Task[None]],
        reply: bytes,
        send: Callable[[bytes], None],
    ) -> None:
        if isinstance(released, asyncio.Event):
            await released.wait()
        if ahead:
            await asyncio.wait(ahead)
        send(reply)


async def until(claim: Callable[[], bool], within_s: float = 5.0) -> None:
    """Wait until a claim holds; fail the test when it does not in time."""
    async with asyncio.timeout(within_s):
        while not claim():  # noqa: ASYNC110  the claim may be about anything, on either side
            await asyncio.sleep(0.001)


@asynccontextmanager
async def tcp_gateway(bus: Bus) -> AsyncIterator[int]:
    """Serve a bus as Modbus TCP; yields the port."""

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            head = await reader.readexactly(7)
            pdu = await reader.readexactly(int.from_bytes(head[4:6], "big") - 1)
            bus.requests.append(head + pdu)

            def send(reply: bytes, head: bytes = head) -> None:
                size = (len(reply) + 1).to_bytes(2, "big")
                writer.write(head[:4] + size + head[6:] + reply)

            await bus.serve(head[6], pdu, send, writer.transport.abort)

    async with _tcp_server(bus, talk) as port:
        yield port


@asynccontextmanager
async def rtu_over_tcp(bus: Bus) -> AsyncIterator[int]:
    """Serve a bus as RTU frames on a TCP stream; yields the port."""

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        buffer = bytearray()
        while chunk := await reader.read(256):
            buffer += chunk
            await _serve_rtu(bus, buffer, writer.write, writer.transport.abort)

    async with _tcp_server(bus, talk) as port:
        yield port


@asynccontextmanager
async def rtu_on_pty(bus: Bus, *, echoes: bool = False) -> AsyncIterator[str]:
    """Serve a bus as RTU frames on a pseudo-terminal; yields the device's name.

    With ``echoes`` as behind an adapter whose receiver stays on while it sends.
    """
    master, slave = os.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    loop = asyncio.get_running_loop()
    chunks: asyncio.Queue[bytes] = asyncio.Queue()
    loop.add_reader(master, lambda: chunks.put_nowait(os.read(master, 256)))

    async def talk() -> None:
        buffer = bytearray()
        while True:
            chunk = await chunks.get()
            if echoes:
                _put(master, chunk)
            buffer += chunk
            await _serve_rtu(bus, buffer, lambda data: _put(master, data), bus.cut)

    is_plugged = True

    def unplug() -> None:
        nonlocal is_plugged
        if is_plugged:
            is_plugged = False
            loop.remove_reader(master)
            os.close(slave)
            os.close(master)

    bus.cut = unplug
    bus.raw_write = lambda data: _put(master, data)
    task = asyncio.create_task(talk())
    try:
        yield os.ttyname(slave)
    finally:
        await _end([task, *bus.held])
        unplug()


def _put(fd: int, data: bytes) -> None:
    os.write(fd, data)


async def _serve_rtu(
    bus: Bus, buffer: bytearray, write: Callable[[bytes], object], cut: Callable[[], None]
) -> None:
    while len(buffer) >= 8:
        size = 9 + buffer[6] if buffer[1] in (15, 16) else 8
        if len(buffer) < size:
            return
        frame = bytes(buffer[:size])
        del buffer[:size]
        assert crc(frame[:-2]) == frame[-2:], frame.hex(" ")
        bus.requests.append(frame)

        def send(reply: bytes, unit: int = frame[0]) -> None:
            body = bytes([unit]) + reply
            write(body + crc(body))

        await bus.serve(frame[0], frame[1:-2], send, cut)


@asynccontextmanager
async def _tcp_server(
    bus: Bus,
    talk: Callable[[asyncio.StreamReader, asyncio.StreamWriter], object],
) -> AsyncIterator[int]:
    tasks: list[asyncio.Task[None]] = []

    async def handle(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        bus.connection_count += 1
        bus.cut = writer.transport.abort
        task = asyncio.current_task()
        assert task is not None
        tasks.append(task)
        try:
            await talk(reader, writer)  # type: ignore[misc]  # either talker is a coroutine
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(handle, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        await _end([*tasks, *bus.held])
        await server.wait_closed()


async def _end(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
