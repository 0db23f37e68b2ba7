"""Devices that answer "later", lines that echo, gateways with ids of their own."""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from modbus_fakes import Bus, rtu_on_pty, tcp_gateway

from drivers.clock import CellClock
from drivers.errors import LaterError, ReplyTimeoutError
from drivers.modbus_link import ModbusLink, RtuAddress, TcpAddress, always, seen_instead

FAST = CellClock(speed=10.0, min_timeout_wall_s=0.5)  # no busy host looks like a silent unit
BUSY, AT_WORK = 6, 5
READ = bytes.fromhex("09 03 07 d0 00 01 85 cf")
ANSWER = bytes.fromhex("09 03 02 00 00 59 85")


class Later:
    """A device that answers so many requests with an exception, then as it should."""

    def __init__(self, answer: Callable[[bytes], bytes | None], code: int, times: int) -> None:
        self._answer = answer
        self._code = code
        self.left = times
        self.seen: list[bytes] = []

    def __call__(self, pdu: bytes) -> bytes | None:
        self.seen.append(pdu)
        if self.left:
            self.left -= 1
            return bytes((pdu[0] | 0x80, self._code))
        return self._answer(pdu)


def two_registers(pdu: bytes) -> bytes:
    return bytes((3, 4, 0, 7, 0, 9)) if pdu[0] == 3 else pdu[:5]


@asynccontextmanager
async def unit_of(device: Later) -> AsyncIterator[ModbusLink]:
    async with (
        tcp_gateway(Bus({1: device})) as port,
        ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link,
    ):
        yield link


@pytest.mark.parametrize("code", [AT_WORK, BUSY])
async def test_a_read_that_is_answered_later_is_asked_again(code: int) -> None:
    async with unit_of(Later(two_registers, code, 3)) as link:
        assert await link.unit(1, "lamps").read_holding_registers(0, 2) == (7, 9)


async def test_a_read_is_asked_again_for_its_time_and_no_longer() -> None:
    device = Later(two_registers, BUSY, 10_000)
    async with unit_of(device) as link:
        with pytest.raises(LaterError, match="it is busy"):
            await link.unit(1, "lamps").read_holding_registers(0, 2)
    assert 2 <= len(device.seen) <= 12


async def test_a_write_that_is_answered_later_is_repeated_only_where_its_caller_allows_it() -> None:
    device = Later(two_registers, BUSY, 1)
    async with unit_of(device) as link:
        unit = link.unit(1, "jaws")
        with pytest.raises(ReplyTimeoutError, match="later"):
            await unit.write_registers(0, (1, 2))
        assert len(device.seen) == 1
        device.left = 2
        await unit.write_registers(0, (1, 2), again=always)
    assert len(device.seen) == 4


async def test_a_write_is_not_repeated_once_something_came_between() -> None:
    device = Later(two_registers, BUSY, 1)
    async with unit_of(device) as link:
        unit = link.unit(1, "jaws")

        async def is_missing() -> bool:
            await unit.write_register(9, 0)  # the stop that came between
            return False

        with pytest.raises(LaterError):
            await unit.write_registers(0, (1, 2), again=is_missing)
    assert [pdu[0] for pdu in device.seen] == [16, 6]


# --- echo ---


async def test_a_line_that_echoes_is_named_and_the_setting_drops_the_echo() -> None:
    async with rtu_on_pty(Bus({9: two_registers}), echoes=True) as device:
        async with ModbusLink(RtuAddress(device, 115200), FAST) as link:
            with pytest.raises(ReplyTimeoutError, match="echoes what is sent, and then an answer"):
                await link.unit(9, "gripper").read_holding_registers(0, 2)
        async with ModbusLink(RtuAddress(device, 115200, echoes=True), FAST) as link:
            unit = link.unit(9, "gripper")
            for _ in range(5):
                assert await unit.read_holding_registers(0, 2) == (7, 9)
            await unit.write_register(3, 4)  # its answer is its echo


@pytest.mark.parametrize(
    ("received", "words"),
    [
        (b"", ""),
        (READ, "echoes what is sent, and nothing usable"),
        (READ + ANSWER, "echoes what is sent, and then an answer"),
        (b"\x00" + ANSWER, "behind 1 odd byte"),
        (ANSWER[:-1] + b"\x00", "no frame, by their checksum"),
        (ANSWER[:4], "no frame, by their checksum"),
        (bytes.fromhex("0a 03 02 00 00 1d 85"), "unit 10"),
        (b"\x55" * 3000, "no frame, by their checksum"),  # a quarter of a second at 115200 baud
    ],
)
def test_what_was_seen_on_a_serial_line_is_named(received: bytes, words: str) -> None:
    seen, check = seen_instead(READ, received, is_tcp=False)
    assert words in seen
    assert bool(check) == bool(received)


# --- gateways ---


@asynccontextmanager
async def gateway(ids: Callable[[int, int], tuple[int, int]]) -> AsyncIterator[int]:
    """Answers with what ``ids`` makes of transaction number and unit id."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                number, _, length, unit = struct.unpack(">HHHB", await reader.readexactly(7))
                pdu = await reader.readexactly(length - 1)
                answer = two_registers(pdu)
                number, unit = ids(number, unit)
                writer.write(struct.pack(">HHHB", number, 0, len(answer) + 1, unit) + answer)
        except asyncio.IncompleteReadError:
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


@pytest.mark.parametrize(
    ("ids", "words"),
    [
        (lambda number, unit: (number + 1, unit), "transaction number 2 instead of 1"),
        (lambda number, unit: (number << 8 & 0xFFFF, unit), "transaction number 256 instead of 1"),
        (lambda number, _: (number, 0), "an answer of unit 0"),
        (lambda number, _: (number, 255), "an answer of unit 255"),
    ],
)
async def test_a_gateway_with_ids_of_its_own_is_named_and_the_setting_takes_its_answers(
    ids: Callable[[int, int], tuple[int, int]], words: str
) -> None:
    async with gateway(ids) as port:
        async with ModbusLink(TcpAddress("127.0.0.1", port), FAST, retry_count=0) as link:
            with pytest.raises(ReplyTimeoutError, match=words):
                await link.unit(1, "lamps").read_holding_registers(0, 2)
        async with ModbusLink(TcpAddress("127.0.0.1", port, returns_ids=False), FAST) as link:
            unit = link.unit(1, "lamps")
            for _ in range(3):
                assert await unit.read_holding_registers(0, 2) == (7, 9)
            await unit.write_register(3, 4)


@pytest.mark.parametrize("retry_count", [0, 1, 3])
async def test_a_silent_unit_is_asked_as_often_as_the_setting_has_it(retry_count: int) -> None:
    seen: list[bytes] = []
    async with (
        tcp_gateway(Bus({1: seen.append})) as port,  # hears, and answers nothing
        ModbusLink(TcpAddress("127.0.0.1", port), FAST, retry_count=retry_count) as link,
    ):
        with pytest.raises(ReplyTimeoutError):
            await link.unit(1, "lamps").read_holding_registers(0, 2)
    assert len(seen) == 1 + retry_count
