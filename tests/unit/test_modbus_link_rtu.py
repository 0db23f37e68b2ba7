"""The link on RTU framing, where a late reply looks like the reply to the latest request."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st
from modbus_fakes import Bus, Map, golden, rtu_on_pty, rtu_over_tcp, until
from pymodbus.pdu import bit_message, register_message

from drivers.clock import CellClock
from drivers.errors import LinkError, ReplyTimeoutError, UnpluggedError
from drivers.modbus_link import (
    FunctionCode,
    ModbusLink,
    ModbusUnit,
    Request,
    RtuAddress,
    RtuOverTcpAddress,
)

CALM = CellClock(speed=10.0, min_timeout_wall_s=1.0)  # no busy host looks like a silent unit
SLOW = CellClock(speed=1e-4)  # the reply time-out is most of an hour: it cannot be the reason
FAST = CellClock(speed=10.0, min_timeout_wall_s=0.12)  # where a time-out is what is tested
PROBES = (
    Request(FunctionCode.READ_HOLDING_REGISTERS, 0, 1),
    Request(FunctionCode.READ_HOLDING_REGISTERS, 0, 2),
)


@asynccontextmanager
async def on_the_line(
    kind: str, bus: Bus, clock: CellClock = FAST
) -> AsyncIterator[tuple[ModbusLink, ModbusUnit]]:
    if kind == "pty":
        async with rtu_on_pty(bus) as device, ModbusLink(RtuAddress(device, 115200), clock) as link:
            yield link, link.unit(9, "gripper", probes=PROBES)
    else:
        async with (
            rtu_over_tcp(bus) as port,
            ModbusLink(RtuOverTcpAddress("127.0.0.1", port), clock) as link,
        ):
            yield link, link.unit(9, "gripper", probes=PROBES)


both_lines = pytest.mark.parametrize("kind", ["pty", "tcp"])


@both_lines
async def test_the_manuals_frames_go_out_and_come_back(kind: str) -> None:
    request, reply = golden("robotiq", "status_gripped")
    move, acknowledge = golden("robotiq", "move_80_40_20")
    answers = {request[1:-2]: reply[1:-2], move[1:-2]: acknowledge[1:-2]}
    bus = Bus({9: answers.__getitem__})
    async with on_the_line(kind, bus, CALM) as (_link, unit):
        await unit.write_registers(0x03E8, [0x0900, 0x0080, 0x4020])
        assert await unit.read_holding_registers(0x07D0, 3) == (0xB900, 0x00FF, 0xBD00)
    assert bus.requests == [move, request]


@both_lines
async def test_a_late_reply_of_the_same_shape_is_not_taken_for_the_next_answer(kind: str) -> None:
    """Both requests read three registers: only the resynchronisation can tell the answers apart."""
    held = asyncio.Event()
    unit_map = Map(holding=dict(enumerate(range(100, 110))))
    bus = Bus({9: unit_map.answer}, troubles=[held])
    async with on_the_line(kind, bus) as (_link, unit):
        reading = asyncio.create_task(unit.read_holding_registers(0, 3))
        await until(lambda: len(bus.requests) >= 2)  # the first try timed out; this is the probe
        held.set()
        assert await reading == (100, 101, 102)
        assert await unit.read_holding_registers(5, 3) == (105, 106, 107)
    assert bus.requests[1][1:6] == bytes.fromhex("03 0000 0001")  # a shape nobody is owed


@both_lines
async def test_a_reply_that_arrives_in_the_place_of_the_probes_answer_is_recognised(
    kind: str,
) -> None:
    held = asyncio.Event()
    unit_map = Map(holding=dict(enumerate(range(100, 110))))
    bus = Bus({9: unit_map.answer}, troubles=[held, "silent"])

    def answer(pdu: bytes) -> bytes | None:
        if len(bus.requests) == 2:
            held.set()  # the probe is on its way when the late reply comes; its own is lost
        return unit_map.answer(pdu)

    bus.units[9] = answer
    async with on_the_line(kind, bus) as (_link, unit):
        assert await unit.read_holding_registers(0, 3) == (100, 101, 102)


@both_lines
async def test_a_late_acknowledge_is_not_taken_for_the_next_writes(kind: str) -> None:
    held = asyncio.Event()
    unit_map = Map(holding=dict.fromkeys(range(10), 0))
    bus = Bus({9: unit_map.answer}, troubles=[held])
    async with on_the_line(kind, bus) as (_link, unit):
        with pytest.raises(ReplyTimeoutError):
            await unit.write_registers(0, [1, 2, 3])
        bus.troubles = [None, "silent"]  # the probe is answered, the second write is not
        held.set()
        with pytest.raises(ReplyTimeoutError):  # the late acknowledge did not vouch for it
            await unit.write_registers(0, [4, 5, 6])


@both_lines
async def test_a_cancelled_request_does_not_put_the_line_out_of_step(kind: str) -> None:
    held = asyncio.Event()
    bus = Bus({9: Map(holding=dict.fromkeys(range(3), 5)).answer}, troubles=[held])
    async with on_the_line(kind, bus, SLOW) as (_link, unit):
        reading = asyncio.create_task(unit.read_holding_registers(0, 3))
        await until(lambda: len(bus.requests) == 1)
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
        stop = asyncio.create_task(unit.write_register(0, 0x0100))
        await asyncio.sleep(0)
        held.set()
        async with asyncio.timeout(600):
            await stop
    assert [frame[1] for frame in bus.requests] == [3, 6]  # no probe and no wait before the stop


async def test_a_request_that_is_cancelled_before_its_turn_is_never_sent() -> None:
    held = asyncio.Event()
    bus = Bus({9: Map(holding={0: 5, 1: 0}).answer}, troubles=[held])
    async with on_the_line("tcp", bus, SLOW) as (_link, unit):
        first = asyncio.create_task(unit.read_holding_registers(0, 1))
        await until(lambda: len(bus.requests) == 1)
        second = asyncio.create_task(unit.write_register(1, 1))
        await asyncio.sleep(0)
        second.cancel()
        with pytest.raises(asyncio.CancelledError):
            await second
        held.set()
        assert await first == (5,)
        assert await unit.read_holding_registers(1, 1) == (0,)
    assert [frame[1] for frame in bus.requests] == [3, 3]


async def test_a_write_that_is_cancelled_during_a_resynchronisation_is_never_sent() -> None:
    bus = Bus({9: Map(holding={0: 5, 1: 0}).answer}, troubles=["silent"])
    async with on_the_line("tcp", bus) as (_link, unit):
        with pytest.raises(ReplyTimeoutError):
            await unit.write_register(0, 5)
        probed = asyncio.Event()
        bus.troubles = [probed]
        second = asyncio.create_task(unit.write_register(1, 1))
        await until(lambda: len(bus.requests) == 2)
        second.cancel()
        await asyncio.wait({second})
        probed.set()
        assert await unit.read_holding_registers(1, 1) == (0,)
    assert [frame[1] for frame in bus.requests if frame[1] == 6] == [6]


@pytest.mark.parametrize("turns", range(8))
async def test_the_line_is_free_again_wherever_a_cancellation_strikes(turns: int) -> None:
    bus = Bus({9: Map(holding={0: 5}).answer})
    async with on_the_line("tcp", bus, CALM) as (_link, unit):
        reading = asyncio.create_task(unit.read_holding_registers(0, 1))
        for _ in range(turns):
            await asyncio.sleep(0)
        reading.cancel()
        await asyncio.wait({reading})
        async with asyncio.timeout(600):
            assert await unit.read_holding_registers(0, 1) == (5,)


@both_lines
async def test_silence_names_line_unit_and_what_to_check(kind: str) -> None:
    bus = Bus()
    async with on_the_line(kind, bus) as (link, unit):
        with pytest.raises(ReplyTimeoutError) as caught:
            await unit.write_register(0, 1)
        assert str(link.address) in str(caught.value)
    assert "unit 9" in str(caught.value)
    assert "check its power" in str(caught.value)


@both_lines
async def test_nothing_is_commanded_while_a_silent_device_may_still_answer(kind: str) -> None:
    bus = Bus()
    async with on_the_line(kind, bus) as (_link, unit):
        for _ in range(2):
            with pytest.raises(ReplyTimeoutError):
                await unit.write_register(7, 1)
    writes = [frame for frame in bus.requests if frame[1] == 6]
    assert len(writes) == 1  # the second call got no further than the probe


@both_lines
async def test_a_line_that_goes_away_is_unplugged_at_once(kind: str) -> None:
    bus = Bus({9: Map(holding={0: 1}).answer}, troubles=["drop"])
    async with on_the_line(kind, bus, SLOW) as (link, unit):
        with pytest.raises(UnpluggedError):
            async with asyncio.timeout(600):
                await unit.write_register(0, 1)
        assert not link.is_connected


async def test_a_line_with_a_bad_checksum_counts_as_silent_and_shows_what_came() -> None:
    damage = bytes.fromhex("09 06 00 00 00 01 00 00")
    bus = Bus()

    def answer(pdu: bytes) -> None:
        bus.raw_write(damage)

    bus.units[9] = answer
    async with rtu_on_pty(bus) as device, ModbusLink(RtuAddress(device, 9600), FAST) as link:
        with pytest.raises(ReplyTimeoutError, match=r"no frame, .*09 06 00 00 00 01 00 00"):
            await link.unit(9, "lamps").write_register(0, 1)


async def test_a_missing_serial_device_is_named_with_the_reason() -> None:
    link = ModbusLink(RtuAddress("/dev/tty-that-is-not-there", 115200), FAST)
    with pytest.raises(LinkError) as caught:
        await link.connect()
    await link.aclose()
    assert "/dev/tty-that-is-not-there at 115200 8N1" in str(caught.value)
    assert "No such file or directory" in str(caught.value)


async def test_a_serial_line_that_another_holds_is_named() -> None:
    bus = Bus({9: Map(holding={0: 1}).answer})
    async with rtu_on_pty(bus) as device, ModbusLink(RtuAddress(device, 115200), FAST):
        second = ModbusLink(RtuAddress(device, 115200), FAST)
        with pytest.raises(LinkError, match="another program holds it"):
            await second.connect()
        await second.aclose()


requests = st.builds(
    Request,
    st.sampled_from([f for f in FunctionCode if f <= 4]),
    st.integers(0, 0xFF00),
    st.integers(1, 40),
)


@given(first=requests, second=requests)
def test_requests_that_do_not_look_alike_do_not_take_each_others_answers(
    first: Request, second: Request
) -> None:
    kinds = {
        1: bit_message.ReadCoilsResponse(bits=[False] * ((second.count + 7) // 8 * 8)),
        2: bit_message.ReadDiscreteInputsResponse(bits=[False] * ((second.count + 7) // 8 * 8)),
        3: register_message.ReadHoldingRegistersResponse(registers=[0] * second.count),
        4: register_message.ReadInputRegistersResponse(registers=[0] * second.count),
    }
    reply = kinds[second.function]
    assert second.is_answered_by(reply)
    assert first.is_answered_by(reply) == first.looks_like(second)
