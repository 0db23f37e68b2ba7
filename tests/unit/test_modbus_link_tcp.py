"""The link over Modbus TCP: which error the caller gets when a gateway or a unit misbehaves."""

import asyncio
import itertools
import logging

import pytest
from modbus_fakes import Bus, Map, golden, tcp_gateway, until

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    LinkError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
)
from drivers.modbus_link import ModbusLink, TcpAddress

CALM = CellClock(speed=10.0, min_timeout_wall_s=1.0)  # no busy host looks like a silent unit
FAST = CellClock(speed=10.0, min_timeout_wall_s=0.12)  # where a time-out is what is tested


def registers(*values: int) -> Map:
    return Map(holding=dict(enumerate(values)))


async def test_reading_the_inputs_of_an_e1214_puts_the_golden_bytes_on_the_wire() -> None:
    request, reply = golden("moxa_e1214", "read_inputs")
    bus = Bus({1: lambda pdu: reply[7:]})
    seen: list[tuple[bool, bytes]] = []
    async with tcp_gateway(bus) as port:
        link = ModbusLink(
            TcpAddress("127.0.0.1", port), CALM, trace=lambda out, data: seen.append((out, data))
        )
        async with link:
            values = await link.unit(1, "io").read_discrete_inputs(0, 6)
    assert bus.requests == [request]
    assert values == (True, True, True, False, False, False)
    assert seen == [(True, request), (False, reply)]


async def test_the_wire_log_shows_both_directions_in_hex(
    caplog: pytest.LogCaptureFixture,
) -> None:
    request, reply = golden("moxa_e1214", "read_inputs")
    bus = Bus({1: lambda pdu: reply[7:]})
    caplog.set_level(logging.DEBUG, "cellctl.wire.modbus")
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        await link.unit(1, "io").read_discrete_inputs(0, 6)
    lines = [r.getMessage() for r in caplog.records if r.name == "cellctl.wire.modbus"]
    assert lines[0].endswith("> " + request.hex(" "))
    assert lines[1].endswith("< " + reply.hex(" "))


async def test_every_kind_of_access_reads_back_what_it_wrote() -> None:
    unit_map = Map(
        holding=dict.fromkeys(range(4), 0),
        inputs={0x30: 7},
        coils=dict.fromkeys(range(10), False),
        discrete={0: True},
    )
    bus = Bus({3: unit_map.answer})
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        unit = link.unit(3, "block")
        await unit.write_registers(0, [1, 2, 65535])
        await unit.write_register(3, 0x0800)
        await unit.write_coils(0, [True] * 9 + [False])
        await unit.write_coil(4, False)
        assert await unit.read_holding_registers(0, 4) == (1, 2, 65535, 0x0800)
        assert await unit.read_input_registers(0x30, 1) == (7,)
        assert await unit.read_discrete_inputs(0, 1) == (True,)
        coils = await unit.read_coils(0, 10)
    assert coils == (True, True, True, True, False, True, True, True, True, False)


@pytest.mark.parametrize("code", [0x0A, 0x0B])
async def test_a_gateway_that_reports_a_silent_unit_is_a_reply_timeout_naming_both(
    code: int,
) -> None:
    bus = Bus(gateway_code=code)
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        unit = link.unit(9, "gripper", check="its 24 V supply")
        with pytest.raises(ReplyTimeoutError) as caught:
            await unit.write_register(0, 1)
    message = str(caught.value)
    assert "unit 9" in message
    assert f"127.0.0.1:{port}" in message
    assert f"exception {code:02X}" in message
    assert "24 V supply" in message
    assert len(bus.requests) == 1  # a write is never repeated


async def test_another_exception_is_a_refusal_with_its_code_and_is_not_repeated() -> None:
    bus = Bus({1: registers(0).answer})
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        with pytest.raises(RefusedError, match="exception 02") as caught:
            await link.unit(1, "io").read_holding_registers(0x1234, 1)
    assert caught.value.code == 2
    assert len(bus.requests) == 1


async def test_a_read_is_repeated_once_when_nothing_comes() -> None:
    bus = Bus({1: registers(42).answer}, troubles=["silent"])
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link:
        assert await link.unit(1, "io").read_holding_registers(0, 1) == (42,)
    assert len(bus.requests) == 2


async def test_a_write_without_a_reply_is_sent_once_and_reported() -> None:
    unit_map = registers(0)
    bus = Bus({1: unit_map.answer}, troubles=["silent"])
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link:
        with pytest.raises(ReplyTimeoutError, match=r"no answer from unit 1 .* within 0.3 s"):
            await link.unit(1, "io").write_register(0, 7)
    assert len(bus.requests) == 1
    assert unit_map.holding[0] == 7  # done after all: the caller must read back


async def test_a_late_reply_with_an_old_number_is_not_taken_for_the_next_answer() -> None:
    held = asyncio.Event()
    unit_map = Map(holding={0: 111, 1: 222})
    bus = Bus({1: unit_map.answer}, troubles=[held])
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link:
        unit = link.unit(1, "io")
        reading = asyncio.create_task(unit.read_holding_registers(0, 1))
        await until(
            lambda: len(bus.requests) >= 2
        )  # the first try has timed out, the second is answered
        held.set()
        assert await reading == (111,)
        assert await unit.read_holding_registers(1, 1) == (222,)


async def test_a_reply_with_the_wrong_register_count_is_a_bad_reply() -> None:
    bus = Bus({1: lambda pdu: bytes.fromhex("03 02 00 07")})
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        with pytest.raises(BadReplyError, match="read_holding_registers 0x0000 x 2"):
            await link.unit(1, "io").read_holding_registers(0, 2)


async def test_an_acknowledge_of_another_address_is_a_bad_reply() -> None:
    bus = Bus({1: lambda pdu: bytes.fromhex("06 00 05 00 07")})
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        with pytest.raises(BadReplyError):
            await link.unit(1, "io").write_register(4, 7)


async def test_nobody_at_the_port_names_transport_host_port_and_what_to_check(
    unused_tcp_port: int,
) -> None:
    link = ModbusLink(TcpAddress("127.0.0.1", unused_tcp_port), CALM)
    with pytest.raises(LinkError) as caught:
        await link.connect()
    await link.aclose()
    message = str(caught.value)
    assert f"Modbus TCP 127.0.0.1:{unused_tcp_port}" in message
    assert "Connection refused" in message
    assert "check cable, power" in message


async def test_reconnecting_backs_off_between_requests(unused_tcp_port: int) -> None:
    slow = CellClock(speed=1.0)
    link = ModbusLink(TcpAddress("127.0.0.1", unused_tcp_port), slow)
    unit = link.unit(1, "io")
    with pytest.raises(LinkError, match="cannot connect"):
        await unit.write_register(0, 1)
    with pytest.raises(LinkError, match="next try in"):
        await unit.write_register(0, 1)
    await link.aclose()


async def test_a_connection_cut_while_a_write_is_under_way_is_unplugged_at_once() -> None:
    clock = CellClock(speed=1e-4)  # the reply time-out is most of an hour: it cannot be the reason
    bus = Bus({1: registers(0).answer}, troubles=["drop"])
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), clock) as link:
        with pytest.raises(UnpluggedError, match=r"ended before unit 1 answered"):
            async with asyncio.timeout(600):
                await link.unit(1, "io").write_register(0, 7)
    assert len(bus.requests) == 1


async def test_a_read_survives_a_cut_connection_by_connecting_again() -> None:
    bus = Bus({1: registers(42).answer}, troubles=["drop"])
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), CALM) as link:
        assert await link.unit(1, "io").read_holding_registers(0, 1) == (42,)
    assert bus.connection_count == 2


async def test_after_several_silences_the_connection_is_opened_anew() -> None:
    bus = Bus({1: registers(42).answer}, troubles=["silent"] * 3)
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link:
        unit = link.unit(1, "io")
        with pytest.raises(ReplyTimeoutError):
            await unit.read_holding_registers(0, 1)
        assert await unit.read_holding_registers(0, 1) == (42,)
    assert bus.connection_count == 2


async def test_devices_behind_one_gateway_take_turns() -> None:
    under_way = 0
    most = 0
    release = asyncio.Event()

    class Counting(Bus):
        async def serve(self, unit, pdu, send, cut):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
            nonlocal under_way, most
            under_way += 1
            most = max(most, under_way)
            await release.wait()
            under_way -= 1
            await super().serve(unit, pdu, send, cut)

    bus = Counting({1: registers(1).answer, 2: registers(2).answer, 9: registers(9).answer})
    slow = CellClock(speed=0.1)
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), slow) as link:
        units = [link.unit(number, f"unit {number}") for number in (1, 2, 9)]
        reads = [
            asyncio.create_task(unit.read_holding_registers(0, 1)) for unit in units for _ in "ab"
        ]
        await until(lambda: bool(bus.requests))
        assert len(bus.requests) == 1  # five more wait for their turn
        release.set()
        assert await asyncio.gather(*reads) == [(1,), (1,), (2,), (2,), (9,), (9,)]
    assert most == 1


async def test_the_pause_between_requests_to_one_device_is_kept_in_cell_time() -> None:
    loop = asyncio.get_running_loop()
    at: list[float] = []
    unit_map = Map(holding={0: 1}, on_access=lambda: at.append(loop.time()))
    bus = Bus({9: unit_map.answer})
    clock = CellClock(speed=0.1)  # 5 ms of the cell are 50 ms here: far above scheduling jitter
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), clock) as link:
        unit = link.unit(9, "gripper", spacing_s=0.005)
        for _ in range(3):
            await unit.read_holding_registers(0, 1)
    assert len(at) == 3
    assert min(b - a for a, b in itertools.pairwise(at)) >= 0.049


async def test_a_cancelled_request_leaves_the_link_usable() -> None:
    held = asyncio.Event()
    bus = Bus({1: registers(42).answer}, troubles=[held])
    clock = CellClock(speed=1e-4)
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), clock) as link:
        unit = link.unit(1, "io")
        reading = asyncio.create_task(unit.read_holding_registers(0, 1))
        await until(lambda: bool(bus.requests))
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
        held.set()
        assert await unit.read_holding_registers(0, 1) == (42,)


async def test_a_closed_link_says_so() -> None:
    link = ModbusLink(TcpAddress("127.0.0.1", 1), CALM)
    await link.aclose()
    with pytest.raises(LinkError, match="closed"):
        await link.unit(1, "io").read_holding_registers(0, 1)


async def test_impossible_requests_are_bugs_and_reach_no_wire() -> None:
    link = ModbusLink(TcpAddress("127.0.0.1", 1), CALM)
    unit = link.unit(1, "io")
    with pytest.raises(ValueError, match="count"):
        await unit.read_holding_registers(0, 126)
    with pytest.raises(ValueError, match="address"):
        await unit.read_holding_registers(0xFFFF, 2)
    with pytest.raises(ValueError, match=r"0\.\.65535"):
        await unit.write_register(0, 70000)
    with pytest.raises(ValueError, match="unit"):
        link.unit(256, "io")
    await link.aclose()


async def test_pymodbus_does_not_shout(caplog: pytest.LogCaptureFixture) -> None:
    bus = Bus({1: registers(0).answer}, troubles=["silent"])
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link:
        with pytest.raises(ReplyTimeoutError):
            await link.unit(1, "io").write_register(0, 7)
    assert [r for r in caplog.records if r.name.startswith("pymodbus")] == []
