"""Clients and fake devices for tests of the Modbus emulators: raw bytes, nothing of the drivers."""

import asyncio
import os
import termios
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

STEP_S = 1 / 240  # the world's step


@dataclass
class EchoDevice:
    """Answers every request with its own PDU and remembers it."""

    unit: int
    hears_broadcast: bool = False
    heard: list[bytes] = field(default_factory=list)

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        self.heard.append(pdu)
        return pdu


@asynccontextmanager
async def tcp_client(
    address: tuple[str, int],
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    reader, writer = await asyncio.open_connection(*address)
    try:
        yield reader, writer
    finally:
        writer.transport.abort()
        with suppress(ConnectionError):
            await writer.wait_closed()


class PtyClient:
    """A master on a terminal: raw as a serial driver has it, or as it was found."""

    def __init__(self, path: str, *, is_made_raw: bool = True) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        if is_made_raw:
            tty.setraw(self._fd, termios.TCSANOW)
        self.received = bytearray()
        self.arrivals: list[tuple[float, int]] = []
        self._news = asyncio.Event()
        asyncio.get_running_loop().add_reader(self._fd, self._take)

    def _take(self) -> None:
        data = os.read(self._fd, 4096)
        self.received += data
        self.arrivals.append((asyncio.get_running_loop().time(), len(data)))
        self._news.set()

    def write(self, data: bytes) -> None:
        assert os.write(self._fd, data) == len(data)

    async def read_exactly(self, count: int, limit_s: float = 5.0) -> bytes:
        async with asyncio.timeout(limit_s):
            while len(self.received) < count:
                self._news.clear()
                await self._news.wait()
        data = bytes(self.received[:count])
        del self.received[:count]
        return data

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._fd)
        os.close(self._fd)


async def until(is_so: Callable[[], bool], limit_s: float = 5.0) -> None:
    """Wait until something is so."""
    async with asyncio.timeout(limit_s):
        while not is_so():  # noqa: ASYNC110 (what is waited for has no event)
            await asyncio.sleep(0.001)


def open_fds() -> set[str]:
    """Return what this process has open, each with its number in the kernel."""
    fds = set()
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the listing's own descriptor
            fds.add(f"{entry.name} {entry.readlink()}")
    return fds
