"""The arm's pseudo-terminal: raw bytes, pacing, clients that come and go."""

import asyncio
import contextlib
import os
import termios
import time
import tty
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from emulators.clock import WorldClock
from emulators.umi_scara import ArmModel, ArmServer, ArmWire, Axis

PATIENCE_S = 600.0


def open_fds() -> Counter[str]:
    """What is open; that of an earlier test may go at any time."""
    fds = Path("/proc/self/fd")
    return Counter(str(entry.readlink()) for entry in fds.iterdir() if entry.is_symlink())


@pytest.fixture
async def wire() -> ArmWire:
    wire = ArmWire(ArmModel(), listening=1)
    wire.run_warm()
    return wire


@pytest.fixture
async def server(wire: ArmWire) -> AsyncIterator[ArmServer]:
    before = open_fds()
    server = ArmServer(wire, WorldClock(speed=10.0))
    await server.start()
    yield server
    await server.aclose()
    assert not open_fds() - before


class Client:
    """A client that knows no serial library: bytes through a file descriptor."""

    def __init__(self, path: Path) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    async def ask(self, request: str, reply_size: int) -> str:
        os.write(self.fd, bytes.fromhex(request))
        return await self.read(reply_size)

    async def read(self, size: int) -> str:
        loop = asyncio.get_running_loop()
        data = b""
        readable = asyncio.Event()
        loop.add_reader(self.fd, readable.set)
        try:
            async with asyncio.timeout(PATIENCE_S):
                while len(data) < size:
                    await readable.wait()
                    readable.clear()
                    with contextlib.suppress(BlockingIOError):  # readiness told twice
                        data += os.read(self.fd, size - len(data))
        finally:
            loop.remove_reader(self.fd)
        return data.hex(" ")

    def close(self) -> None:
        os.close(self.fd)


@contextlib.asynccontextmanager
async def client_at_speed(wire: ArmWire, speed: float) -> AsyncIterator[Client]:
    server = ArmServer(wire, WorldClock(speed=speed))
    await server.start()
    client = Client(server.path)
    try:
        yield client
    finally:
        client.close()
        await server.aclose()


@pytest.fixture
async def client(server: ArmServer) -> AsyncIterator[Client]:
    client = Client(server.path)
    yield client
    client.close()


async def test_a_client_is_answered(client: Client) -> None:
    assert await client.ask("01", 1) == "21"
    assert await client.ask("29", 1) == "00"
    assert await client.ask("38", 3) == "20 02 03"


@pytest.mark.parametrize("low", range(256))
async def test_no_byte_is_eaten_by_the_terminal_in_either_direction(
    wire: ArmWire, low: int
) -> None:
    """All values, among them 03, 0a, 0d, 11, 13 and 7f, which a cooked terminal keeps."""
    async with client_at_speed(wire, 100.0) as client:
        value = f"{low:02x} {low ^ 0xFF:02x}"
        assert (await client.ask(f"59 {value}", 1))[0] == "a"
        assert (await client.ask("49", 3))[3:] == value


async def test_the_line_does_not_echo(client: Client) -> None:
    assert await client.ask("01", 1) == "21"
    assert await client.ask("01", 1) == "21"
    with pytest.raises(BlockingIOError):
        os.read(client.fd, 1)


async def test_clients_may_come_and_go(server: ArmServer) -> None:
    for _ in range(3):
        client = Client(server.path)
        assert await client.ask("01", 1) == "21"
        client.close()


async def test_a_client_that_leaves_in_the_middle_of_a_request_does_not_end_the_arm(
    server: ArmServer,
) -> None:
    first = Client(server.path)
    os.write(first.fd, bytes.fromhex("70 04"))
    first.close()
    second = Client(server.path)
    assert await second.read(1) == "0b"  # the line, not the client, ran out of time
    assert await second.ask("01", 1) == "21"
    second.close()


async def test_a_client_may_set_the_terminal_raw_itself(server: ArmServer) -> None:
    client = Client(server.path)
    tty.setraw(client.fd)
    assert await client.ask("01", 1) == "21"
    client.close()


async def test_replies_come_no_faster_than_9600_baud_of_world_time(wire: ArmWire) -> None:
    speed = 0.02  # so slow that a byte takes 52 ms of the wall clock
    async with client_at_speed(wire, speed) as client:
        asked_s = time.monotonic()
        first = await client.ask("38", 1)
        first_s = time.monotonic()
        rest = await client.read(2)
        last_s = time.monotonic()
    assert (first, rest) == ("21", "02 03")
    byte_s = 10 / 9600 / speed
    assert first_s - asked_s >= byte_s + 0.001 / speed - 0.002
    assert last_s - asked_s >= 3 * byte_s + 0.001 / speed - 0.002


async def test_a_stable_link_replaces_a_stale_one_and_goes_with_the_server(
    wire: ArmWire, tmp_path: Path
) -> None:
    link = tmp_path / "arm"
    link.symlink_to("/dev/pts/nowhere")
    server = ArmServer(wire, WorldClock(speed=10.0), link_path=link)
    await server.start()
    client = Client(link)
    assert await client.ask("01", 1) == "21"
    client.close()
    assert link.resolve() == server.path.resolve()
    await server.aclose()
    await server.aclose()
    assert not link.is_symlink()


async def test_a_link_taken_over_by_a_successor_is_left_alone(
    wire: ArmWire, tmp_path: Path
) -> None:
    link = tmp_path / "arm"
    first = ArmServer(wire, WorldClock(), link_path=link)
    await first.start()
    second = ArmServer(wire, WorldClock(), link_path=link)
    await second.start()
    await first.aclose()
    assert link.is_symlink()
    await second.aclose()
    assert not link.is_symlink()


async def test_a_file_in_the_place_of_the_link_is_not_overwritten(
    wire: ArmWire, tmp_path: Path
) -> None:
    link = tmp_path / "arm"
    link.write_text("mine")
    before = open_fds()
    server = ArmServer(wire, WorldClock(), link_path=link)
    with pytest.raises(FileExistsError):
        await server.start()
    await server.aclose()
    assert link.read_text() == "mine"
    assert not open_fds() - before


async def test_an_unread_line_does_not_block_the_arm(
    wire: ArmWire, caplog: pytest.LogCaptureFixture
) -> None:
    async with client_at_speed(wire, 1000.0) as client:
        deadline_s = time.monotonic() + PATIENCE_S
        while "nobody reads" not in caplog.text:  # more replies than the terminal holds
            assert time.monotonic() < deadline_s
            with contextlib.suppress(BlockingIOError):
                os.write(client.fd, b"\x38" * 1000)
            await asyncio.sleep(0.001)
        termios.tcflush(client.fd, termios.TCIOFLUSH)
        answer = await client.ask("04", 1)
        while answer != "09":  # unknown opcode; before it may come late bytes of the flood
            assert answer in ("21", "02", "03")
            answer = await client.read(1)


async def test_the_path_of_a_server_that_does_not_run_is_an_error(wire: ArmWire) -> None:
    server = ArmServer(wire, WorldClock())
    with pytest.raises(ValueError, match="not been started"):
        _ = server.path
    await server.start()
    with pytest.raises(ValueError, match="runs already"):
        await server.start()
    await server.aclose()
    with pytest.raises(ValueError, match="not been started"):
        _ = server.path


async def test_the_model_moves_by_the_worlds_hand_only(client: Client, wire: ArmWire) -> None:
    assert await client.ask("80 04 00", 1) == "00"
    at = wire.model.axes[Axis.SHOULDER].position
    assert await client.ask("11", 3) == "11 01 00"
    assert wire.model.axes[Axis.SHOULDER].position == at
    wire.model.advance(0.5)
    assert wire.model.axes[Axis.SHOULDER].position > at
