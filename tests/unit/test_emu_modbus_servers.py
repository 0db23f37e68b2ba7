import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from emu_modbus_bench import EchoDevice, PtyClient, open_fds, tcp_client, until

from emulators.byte_faults import ByteFault, Harm
from emulators.clock import WorldClock
from emulators.gripper_modbus import RobotiqDevice
from emulators.modbus import (
    Bus,
    RtuOverTcpServer,
    RtuPtyServer,
    Stepper,
    TcpGateway,
    TcpServer,
    encode_rtu,
)

READ = bytes.fromhex("03 0000 0001")
LINE_GRAIN_S = 0.0006  # waits nearer than half a millisecond count as over (see the pacer)


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await asyncio.sleep(0)  # transports close in the loop's next round
    assert asyncio.all_tasks() == {asyncio.current_task()}
    assert {fd for fd in open_fds() - fds if "/proc/" not in fd} == set()


@pytest.fixture
def bus() -> Bus:
    return Bus([EchoDevice(1), EchoDevice(2)])


@pytest.fixture
def clock() -> Iterator[WorldClock]:
    return WorldClock()


@pytest.fixture
async def gateway(bus: Bus, clock: WorldClock) -> AsyncIterator[TcpGateway]:
    gateway = TcpGateway(bus, clock, reply_timeout_s=0.05)
    await gateway.start()
    yield gateway
    await gateway.aclose()


def mbap(transaction: int, unit: int, pdu: bytes = READ) -> bytes:
    return bytes((0, transaction, 0, 0, 0, len(pdu) + 1, unit)) + pdu


Client = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def ask(client: Client, request: bytes, reply_length: int) -> bytes:
    client[1].write(request)
    async with asyncio.timeout(600):
        return await client[0].readexactly(reply_length)


async def is_silent(client: Client, wall_s: float = 0.1) -> bool:
    try:
        async with asyncio.timeout(wall_s):
            return not await client[0].read(1)
    except TimeoutError:
        return True


# --- gateway --------------------------------------------------------------------------------------


async def test_a_reply_carries_transaction_and_unit_of_its_request(gateway: TcpGateway) -> None:
    async with tcp_client(gateway.address) as client:
        assert await ask(client, mbap(7, 2), 12) == mbap(7, 2)


async def test_a_silent_device_is_exception_0b_after_the_gateways_own_timeout(
    gateway: TcpGateway,
) -> None:
    async with tcp_client(gateway.address) as client:
        before_s = time.monotonic()
        assert await ask(client, mbap(1, 9), 9) == bytes.fromhex("0001 0000 0003 09 83 0B")
        assert time.monotonic() - before_s >= 0.05 - LINE_GRAIN_S


async def test_the_gateways_timeout_is_world_time(bus: Bus) -> None:
    gateway = TcpGateway(bus, WorldClock(speed=50_000.0), reply_timeout_s=10_000.0)
    await gateway.start()
    async with tcp_client(gateway.address) as client:
        before_s = time.monotonic()
        await ask(client, mbap(1, 9), 9)
        assert time.monotonic() - before_s >= 0.2 - LINE_GRAIN_S
    await gateway.aclose()


async def test_a_gateway_may_leave_silence_unanswered(bus: Bus, clock: WorldClock) -> None:
    gateway = TcpGateway(bus, clock, reply_timeout_s=0.02, is_silence_answered=False)
    await gateway.start()
    async with tcp_client(gateway.address) as client:
        client[1].write(mbap(1, 9))
        assert await is_silent(client)
        assert await ask(client, mbap(2, 1), 12) == mbap(2, 1)
    await gateway.aclose()


async def test_eight_channels_at_9600_baud_take_33_characters(clock: WorldClock) -> None:
    # modbus_devices.md 6.1: FC16 of 8 channels and its reply are 33 characters, 35 ms
    class Acknowledging(EchoDevice):
        def request(self, pdu: bytes, now_s: float) -> bytes | None:
            return pdu[:5]

    gateway = TcpGateway(Bus([Acknowledging(1)]), clock, baudrate=9600)
    await gateway.start()
    write = bytes.fromhex("10 0000 0008 10") + bytes(16)
    async with tcp_client(gateway.address) as client:
        before_s = time.monotonic()
        await ask(client, mbap(1, 1, write), 12)
        assert time.monotonic() - before_s >= 33 * 10 / 9600 - LINE_GRAIN_S
    await gateway.aclose()


async def test_clients_share_the_line_one_request_at_a_time(bus: Bus, clock: WorldClock) -> None:
    gateway = TcpGateway(bus, clock, baudrate=9600, turnaround_s=0.0)
    await gateway.start()
    async with tcp_client(gateway.address) as one, tcp_client(gateway.address) as two:
        before_s = time.monotonic()
        await asyncio.gather(ask(one, mbap(1, 1), 12), ask(two, mbap(1, 2), 12))
        # two exchanges of 8 + 8 characters with a gap of 3.5 between request and request
        assert time.monotonic() - before_s >= (2 * 16 + 3.5) * 10 / 9600 - 2 * LINE_GRAIN_S
        assert gateway.client_count == 2
    await gateway.aclose()


async def test_requests_sent_without_waiting_are_answered_in_order(gateway: TcpGateway) -> None:
    async with tcp_client(gateway.address) as client:
        replies = await ask(client, mbap(1, 1) + mbap(2, 2) + mbap(3, 1), 36)
    assert replies == mbap(1, 1) + mbap(2, 2) + mbap(3, 1)


async def test_a_broadcast_reaches_who_hears_it_and_is_not_answered(gateway: TcpGateway) -> None:
    hearing = EchoDevice(5, hears_broadcast=True)
    gateway.bus.attach(hearing)
    async with tcp_client(gateway.address) as client:
        client[1].write(mbap(1, 0, bytes.fromhex("06 0000 0001")))
        assert await is_silent(client)
    assert hearing.heard == [bytes.fromhex("06 0000 0001")]
    assert gateway.bus.devices[0].heard == []  # type: ignore[attr-defined] # an EchoDevice


async def test_a_stream_that_is_not_modbus_is_cut(gateway: TcpGateway) -> None:
    async with tcp_client(gateway.address) as client:
        client[1].write(b"GET / HTTP/1.1\r\n\r\n")
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await ask(client, b"", 1)


async def test_a_restarted_gateway_is_at_its_old_address(gateway: TcpGateway) -> None:
    address = gateway.address
    async with tcp_client(address) as client:
        await ask(client, mbap(1, 1), 12)
        await gateway.aclose()
        assert await client[0].read(1) == b""
    await gateway.start()
    assert gateway.address == address
    async with tcp_client(address) as client:
        assert await ask(client, mbap(2, 1), 12) == mbap(2, 1)


async def test_closing_with_a_request_under_way_leaves_nothing(gateway: TcpGateway) -> None:
    gateway.bus.faults(1).reply_delay_s = 100.0
    async with tcp_client(gateway.address) as client:
        client[1].write(mbap(1, 1))
        await until(lambda: bool(gateway.bus.devices[0].heard))  # type: ignore[attr-defined] # an EchoDevice
        await gateway.aclose()


# --- faults ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "value"),
    [
        ("is_mute", True),
        ("is_deaf", True),
        ("is_crc_bad", True),
        ("reply_byte_count", 3),
        ("reply_unit", 4),
        ("reply_delay_s", 0.5),
    ],
)
async def test_behind_a_gateway_every_broken_reply_looks_silent_once(
    gateway: TcpGateway, fault: str, value: float
) -> None:
    faults = gateway.bus.faults(1)
    setattr(faults, fault, value)
    faults.requests_left = 1
    async with tcp_client(gateway.address) as client:
        assert (await ask(client, mbap(1, 1), 9))[-2:] == bytes.fromhex("83 0B")
        assert await ask(client, mbap(2, 2), 12) == mbap(2, 2)
        assert await ask(client, mbap(3, 1), 12) == mbap(3, 1)
    heard = gateway.bus.devices[0].heard  # type: ignore[attr-defined] # an EchoDevice
    assert len(heard) == (1 if fault == "is_deaf" else 2)  # mute is not deaf


async def test_an_exception_can_be_put_in_a_devices_mouth(gateway: TcpGateway) -> None:
    gateway.bus.faults(1).exception_code = 6
    async with tcp_client(gateway.address) as client:
        assert (await ask(client, mbap(1, 1), 9))[-2:] == bytes.fromhex("83 06")
        gateway.bus.clear_faults()
        assert await ask(client, mbap(2, 1), 12) == mbap(2, 1)


async def test_a_connection_can_drop_where_the_reply_should_come(gateway: TcpGateway) -> None:
    gateway.bus.faults(1).is_connection_dropped = True
    async with tcp_client(gateway.address) as client, tcp_client(gateway.address) as other:
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await ask(client, mbap(1, 1), 12)
        assert await ask(other, mbap(2, 2), 12) == mbap(2, 2)
        gateway.drop_connections()
        assert await other[0].read(1) == b""
    assert gateway.bus.devices[0].heard == [READ]  # type: ignore[attr-defined] # an EchoDevice


async def test_a_line_that_cannot_be_reached_ends_connections_old_and_new(
    gateway: TcpGateway,
) -> None:
    gateway.is_reachable = False
    async with tcp_client(gateway.address) as client:
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await ask(client, mbap(1, 1), 12)
    gateway.is_reachable = True
    async with tcp_client(gateway.address) as client:
        assert await ask(client, mbap(2, 1), 12) == mbap(2, 1)


async def test_a_native_device_delays_and_damages_its_own_frames(
    bus: Bus, clock: WorldClock
) -> None:
    server = TcpServer(bus, clock)
    await server.start()
    async with tcp_client(server.address) as client:
        client[1].write(mbap(1, 9))
        assert await is_silent(client, 0.05)
        bus.faults(1).reply_delay_s = 0.05
        before_s = time.monotonic()
        assert await ask(client, mbap(2, 1), 12) == mbap(2, 1)
        assert time.monotonic() - before_s >= 0.05 - LINE_GRAIN_S
        bus.clear_faults()
        bus.faults(1).is_crc_bad = True
        assert (await ask(client, mbap(3, 1), 12))[2:4] != b"\x00\x00"
        bus.clear_faults()
        bus.faults(1).reply_byte_count = 9
        assert await ask(client, mbap(4, 1), 9) == mbap(4, 1)[:9]
        assert await is_silent(client, 0.05)
    await server.aclose()


async def test_a_native_device_may_answer_0b_for_a_unit_it_has_not(
    bus: Bus, clock: WorldClock
) -> None:
    server = TcpServer(bus, clock, is_silence_answered=True)
    await server.start()
    async with tcp_client(server.address) as client:
        assert await ask(client, mbap(1, 9), 9) == bytes.fromhex("0001 0000 0003 09 83 0B")
    await server.aclose()


# --- RTU ------------------------------------------------------------------------------------------


@pytest.fixture
async def pty(bus: Bus, clock: WorldClock) -> AsyncIterator[RtuPtyServer]:
    server = RtuPtyServer(bus, clock)
    await server.start()
    yield server
    await server.aclose()


@pytest.fixture
async def master(pty: RtuPtyServer) -> AsyncIterator[PtyClient]:
    master = PtyClient(pty.path)
    yield master
    master.close()


async def test_every_byte_value_passes_a_terminal_raw_from_the_start(pty: RtuPtyServer) -> None:
    master = PtyClient(pty.path, is_made_raw=False)
    for start in range(0, 256, 64):
        frame = encode_rtu(1, b"\x10\x00\x00\x00\x20\x40" + bytes(range(start, start + 64)))
        master.write(frame)
        assert await master.read_exactly(len(frame)) == frame
    master.close()


async def test_a_unit_nobody_has_is_silence_on_a_serial_line(master: PtyClient) -> None:
    master.write(encode_rtu(9, READ))
    await asyncio.sleep(0.05)  # what must not come has no event to wait for
    master.write(encode_rtu(1, READ))
    assert await master.read_exactly(8) == encode_rtu(1, READ)


async def test_a_frame_in_two_halves_is_one_and_a_spoilt_one_is_none(master: PtyClient) -> None:
    frame = encode_rtu(1, READ)
    master.write(frame[:3])
    master.write(frame[3:])
    assert await master.read_exactly(8) == frame
    master.write(frame + frame)  # no pause between them
    await asyncio.sleep(0.3)
    master.write(frame)
    assert await master.read_exactly(8) == frame
    assert not master.received


async def test_reply_characters_leave_one_by_one_as_they_fall_due(bus: Bus) -> None:
    server = RtuPtyServer(bus, WorldClock(), baudrate=1200)
    await server.start()
    master = PtyClient(server.path)
    frame = encode_rtu(1, READ)
    before_s = asyncio.get_running_loop().time()
    master.write(frame)
    assert await master.read_exactly(8) == frame
    first_s, _ = master.arrivals[0]
    last_s, _ = master.arrivals[-1]
    character_s = 10 / 1200
    assert len(master.arrivals) > 1
    # request, silence and one character of the reply lie before the first one's arrival
    assert first_s - before_s >= (8 + 3.5 + 1) * character_s - 2 * LINE_GRAIN_S
    assert last_s - before_s >= (8 + 3.5 + 8) * character_s - 2 * LINE_GRAIN_S
    master.close()
    await server.aclose()


async def test_the_line_outlives_its_clients(pty: RtuPtyServer) -> None:
    frame = encode_rtu(2, READ)
    for _ in range(3):
        master = PtyClient(pty.path)
        master.write(frame)
        assert await master.read_exactly(8) == frame
        master.close()


async def test_a_late_reply_comes_late_and_in_full(master: PtyClient, bus: Bus) -> None:
    bus.faults(1).reply_delay_s = 0.1
    before_s = time.monotonic()
    master.write(encode_rtu(1, READ))
    assert await master.read_exactly(8) == encode_rtu(1, READ)
    assert time.monotonic() - before_s >= 0.1 - LINE_GRAIN_S


@pytest.mark.parametrize(
    ("fault", "value", "expected"),
    [
        ("is_crc_bad", True, "01 03 00 00 00 01 84 4A"),
        ("reply_byte_count", 5, "01 03 00 00 00"),
        ("reply_unit", 2, "02 03 00 00 00 01 84 39"),
        ("exception_code", 2, "01 83 02 C0 F1"),
        ("reply_fault", (1, ByteFault(harm=Harm.LOST)), "01 00 00 00 01 84 0A"),
        ("reply_fault", (0, ByteFault(harm=Harm.DOUBLED)), "01 01 03 00 00 00 01 84 0A"),
        ("reply_fault", (6, ByteFault(harm=Harm.FLIPPED, bit=7)), "01 03 00 00 00 01 04 0A"),
        ("reply_fault", (99, ByteFault(harm=Harm.FLIPPED, bit=0)), "01 03 00 00 00 01 84 0B"),
        ("reply_fault", (4, ByteFault(harm=Harm.LATE)), "01 03 00 00 00 01 84 0A"),
    ],
)
async def test_faults_reach_the_serial_line_as_bytes(
    master: PtyClient, bus: Bus, fault: str, value: int, expected: str
) -> None:
    # 01 03 0000 0001 84 0A and 01 83 02 C0 F1 are printed in every Modbus tutorial; one bit flips
    setattr(bus.faults(1), fault, value)
    master.write(bytes.fromhex("01 03 00 00 00 01 84 0A"))
    assert await master.read_exactly(len(bytes.fromhex(expected))) == bytes.fromhex(expected)
    assert not master.received


async def test_a_link_keeps_the_terminals_name_over_a_restart(bus: Bus, tmp_path: Path) -> None:
    link = tmp_path / "gripper"
    server = RtuPtyServer(bus, WorldClock(), link=link)
    for _ in range(2):
        await server.start()
        assert server.path == str(link)
        master = PtyClient(str(link))
        master.write(encode_rtu(1, READ))
        assert await master.read_exactly(8) == encode_rtu(1, READ)
        master.close()
        await server.aclose()
        assert not link.exists()


async def test_rtu_frames_travel_over_tcp_and_faults_with_them(bus: Bus, clock: WorldClock) -> None:
    server = RtuOverTcpServer(bus, clock)
    await server.start()
    frame = encode_rtu(1, READ)
    async with tcp_client(server.address) as client:
        assert await ask(client, frame, 8) == frame
        client[1].write(frame[:-1] + b"\x00")
        assert await is_silent(client, 0.05)
        assert await ask(client, frame, 8) == frame
        bus.faults(1).is_connection_dropped = True
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await ask(client, frame, 8)
    await server.aclose()


async def test_replies_to_two_clients_of_one_line_follow_each_other(
    bus: Bus, clock: WorldClock
) -> None:
    server = RtuOverTcpServer(bus, clock, baudrate=9600)
    await server.start()
    one, two = encode_rtu(1, READ), encode_rtu(2, READ)
    async with tcp_client(server.address) as first, tcp_client(server.address) as second:
        before_s = time.monotonic()
        replies = await asyncio.gather(ask(first, one, 8), ask(second, two, 8))
        # request and silence may coincide, the two replies of 8 characters may not
        assert time.monotonic() - before_s >= (8 + 3.5 + 16) * 10 / 9600 - 2 * LINE_GRAIN_S
        assert replies == [one, two]
    await server.aclose()


async def test_a_fast_world_does_not_lose_frames(bus: Bus) -> None:
    server = RtuPtyServer(bus, WorldClock(speed=20.0))
    await server.start()
    master = PtyClient(server.path)
    frame = encode_rtu(1, READ)
    for _ in range(50):
        master.write(frame)
        assert await master.read_exactly(8) == frame
    master.close()
    await server.aclose()


# --- time without a world -------------------------------------------------------------------------


async def test_a_stepper_advances_devices_with_the_clock_and_stops() -> None:
    class Aging:
        age_s = 0.0

        def advance(self, dt_s: float) -> None:
            self.age_s += dt_s

    device, clock = Aging(), WorldClock(speed=20.0)
    stepper = Stepper(clock, [device])
    started_s = clock.now_s()
    await stepper.start()
    await until(lambda: device.age_s > 1.0)
    await stepper.aclose()
    stopped_s = device.age_s
    assert stopped_s <= clock.now_s() - started_s
    await asyncio.sleep(0.02)
    assert device.age_s == stopped_s


async def test_a_gripper_is_activated_and_closed_through_a_gateway() -> None:
    clock = WorldClock(speed=10.0)
    gripper = RobotiqDevice()
    gateway, stepper = TcpGateway(Bus([gripper]), clock), Stepper(clock, [gripper])
    await gateway.start()
    await stepper.start()

    async with tcp_client(gateway.address) as client:

        async def write(action: int, position: int) -> None:
            request = bytes.fromhex("10 03E8 0003 06") + bytes((action, 0, 0, position, 255, 255))
            await ask(client, mbap(1, 9, request), 12)

        async def status(expected: int) -> None:
            async with asyncio.timeout(600):
                while True:
                    reply = await ask(client, mbap(2, 9, bytes.fromhex("03 07D0 0003")), 15)
                    if reply[9] == expected:
                        return

        await write(0x00, 0x00)
        await status(0x00)
        await write(0x01, 0x00)
        await status(0x31)
        await write(0x09, 0xFF)
        await status(0xF9)
    assert gripper.jaws.opening_mm == pytest.approx(0.0, abs=0.02)
    await stepper.aclose()
    await gateway.aclose()
