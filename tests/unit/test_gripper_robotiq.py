"""The Robotiq driver against a gripper written from the manual, over each transport.

Sections (§) are those of modbus_devices.md.
"""

import asyncio
import itertools
import statistics
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field

import pytest
from modbus_fakes import Bus, Map, golden, rtu_on_pty, rtu_over_tcp, tcp_gateway, until, words

from drivers.clock import CellClock
from drivers.errors import (
    FaultError,
    LinkError,
    PositionLostError,
    ReplyTimeoutError,
    StalledError,
    WrongDeviceError,
)
from drivers.gripper_modbus import (
    ActivationState,
    GraspEvidence,
    Gripper,
    GripperConfig,
    Hold,
    ObjectState,
    StoppedError,
)
from drivers.modbus_link import ModbusLink, RtuAddress, RtuOverTcpAddress, TcpAddress

FAST = CellClock(speed=20.0, min_timeout_wall_s=1.0)  # no busy host looks like a silent gripper
IMPATIENT = CellClock(speed=20.0, min_timeout_wall_s=0.12)  # where a time-out is what is tested


@dataclass
class Robotiq:
    """A 2F-85 whose time is the number of times it was asked for its status."""

    outputs: bytearray = field(default_factory=lambda: bytearray(6))
    is_active: bool = True
    activation_reads: int = 3
    position: int = 3
    part_outside: int | None = None  # counts at which a part stops the closing jaws
    part_inside: int | None = None  # counts at which a part stops the opening jaws
    misses_contact: bool = False
    fault: int = 0
    frozen: bool = False
    counts_per_read: int = 60
    writes: list[bytes] = field(default_factory=list)
    on_status: list[int] = field(default_factory=list)
    _activating: int = 0
    _object: int = 3

    def __post_init__(self) -> None:
        if self.is_active:
            self.outputs[0] = 0x01

    @property
    def action(self) -> int:
        return self.outputs[0]

    def answer(self, pdu: bytes) -> bytes | None:
        address, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        if pdu[0] in (3, 4) and address == 0x07D0 and count <= 3:
            self._live()
            data = self._inputs()[: 2 * count]
            return bytes([pdu[0], len(data)]) + data
        if pdu[0] == 16 and address == 0x03E8 and count == 3:
            self._write(pdu[6:12])
            return pdu[:5]
        if pdu[0] == 6 and address == 0x03E8:
            self._write(pdu[3:5] + bytes(self.outputs[2:]))
            return pdu
        return None  # §2.1: it never answers with an exception

    def _write(self, data: bytes) -> None:
        self.writes.append(bytes(data))
        had_ract = self.outputs[0] & 1
        self.outputs[:] = data
        if not data[0] & 1:
            self.is_active = False
            self._activating = 0
            self.fault = 0
        elif not had_ract:
            self._activating = self.activation_reads
        if data[0] & 8:
            self._object = 0

    def _live(self) -> None:
        if self._activating and not self.frozen:
            self._activating -= 1
            self.is_active = self._activating == 0
            return
        if not (self.is_active and self.action & 8) or self.frozen:
            return
        target = min(max(self.outputs[3], 3), 230)
        step = max(-self.counts_per_read, min(self.counts_per_read, target - self.position))
        here = self.position + step
        self._object = 0
        if step >= 0 and self.part_outside is not None and here >= self.part_outside:
            here = self.part_outside
            self._object = 3 if self.misses_contact else 2
        elif step <= 0 and self.part_inside is not None and here <= self.part_inside:
            here = self.part_inside
            self._object = 1
        elif here == target:
            self._object = 3
        self.position = here

    def _inputs(self) -> bytes:
        state = 3 if self.is_active else (1 if self._activating else 0)
        status = (self.action & 0x09) | state << 4 | self._object << 6
        return bytes([status, 0, self.fault, self.outputs[3], self.position, 0])

    def lose_power(self) -> None:
        self.outputs[:] = bytes(6)
        self.is_active = False
        self._activating = 0


@asynccontextmanager
async def link_to(
    bus: Bus, transport: str = "tcp", clock: CellClock = FAST
) -> AsyncIterator[ModbusLink]:
    async with AsyncExitStack() as stack:
        address: TcpAddress | RtuAddress | RtuOverTcpAddress
        if transport == "tcp":
            address = TcpAddress("127.0.0.1", await stack.enter_async_context(tcp_gateway(bus)))
        elif transport == "rtu":
            address = RtuAddress(await stack.enter_async_context(rtu_on_pty(bus)), 115200)
        else:
            port = await stack.enter_async_context(rtu_over_tcp(bus))
            address = RtuOverTcpAddress("127.0.0.1", port)
        yield await stack.enter_async_context(ModbusLink(address, clock))


@asynccontextmanager
async def gripper_on(
    device: Robotiq, transport: str = "tcp", clock: CellClock = FAST
) -> AsyncIterator[Gripper]:
    bus = Bus({9: device.answer})
    async with link_to(bus, transport, clock) as link, Gripper(link) as gripper:
        yield gripper


# --- golden bytes ---


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # the values are the reference's own reading of each frame, §2.7
        ("status_closing", (True, True, 3, 0, 0, 0xFF, 0x0E, 100)),
        ("status_gripped", (True, True, 3, 2, 0, 0xFF, 0xBD, 0)),
        ("status_opening", (True, True, 3, 0, 0, 0x00, 0xBB, 160)),
        ("status_open", (True, True, 3, 3, 0, 0x00, 0x0D, 0)),
        ("status_closed_on_nothing", (True, True, 3, 3, 0, 0xFF, 0xE6, 0)),
        ("status_gripped_inside", (True, True, 3, 1, 0, 0x00, 0x5A, 0)),
        ("fault_07", (False, False, 0, 0, 0x07, 0, 3, 0)),
        ("fault_05", (True, False, 1, 0, 0x05, 0, 0, 0)),
        ("fault_0b", (True, False, 0, 0, 0x0B, 0, 0x50, 0)),
        ("fault_0f", (True, False, 0, 0, 0x0F, 0, 3, 0)),
        ("fault_0d", (True, False, 1, 0, 0x0D, 0, 0, 0)),
        ("fault_0e", (True, True, 3, 0, 0x0E, 0xFF, 0x80, 640)),
        ("fault_0a", (True, False, 3, 0, 0x0A, 0, 3, 0)),
    ],
)
async def test_the_worked_status_frames_mean_what_the_manual_says(
    name: str, expected: tuple[bool, bool, int, int, int, int, int, int]
) -> None:
    request, reply = golden("robotiq", name)
    bus = Bus({9: lambda pdu: reply[1:-2]})
    async with link_to(bus, "rtu") as link:
        status = await Gripper(link).status()
    assert bus.requests == [request]
    assert expected == (
        status.is_powered_on,
        status.is_going,
        status.activation,
        status.object,
        status.fault,
        status.requested_counts,
        status.position_counts,
        status.current_ma,
    )


async def test_activating_closing_opening_and_stopping_put_the_golden_bytes_on_the_wire() -> None:
    device = Robotiq(is_active=False)
    bus = Bus({9: device.answer})
    async with link_to(bus, "rtu") as link, Gripper(link) as gripper:
        await gripper.activate()
        await gripper.close_on(0.0, speed_mm_s=150.0, force_n=235.0)
        await gripper.open_to(85.0, speed_mm_s=150.0, force_n=235.0)
        await gripper.stop()
    writes = [frame for frame in bus.requests if frame[1] != 3]
    names = ["activate_clear", "activate_set", "close_fully", "open_fully", "stop"]
    assert writes == [golden("robotiq", name)[0] for name in names]


# --- activation and identity ---


@pytest.mark.parametrize("transport", ["tcp", "rtu", "rtu over tcp"])
async def test_one_setting_chooses_the_transport(transport: str) -> None:
    device = Robotiq(is_active=False, part_outside=120)
    async with gripper_on(device, transport) as gripper:
        await gripper.activate()
        grasp = await gripper.close_on(speed_mm_s=150.0)
        assert grasp.object_detected
        await gripper.open_to(60.0)
    assert device.position == 70  # 230 - 60 * 227 / 85 = 69.8


async def test_connecting_to_a_gripper_that_holds_a_part_neither_moves_nor_drops_it() -> None:
    device = Robotiq(position=120, part_outside=120)
    device.outputs[:] = bytes([9, 0, 0, 255, 128, 128])
    async with gripper_on(device) as gripper:
        await gripper.activate()
        assert await gripper.hold() is Hold.HELD
    assert device.writes == []


async def test_an_inactive_gripper_refuses_to_move_and_is_not_activated_unasked() -> None:
    device = Robotiq(is_active=False)
    async with gripper_on(device) as gripper:
        with pytest.raises(PositionLostError, match="activate it"):
            await gripper.open_to(40.0)
    assert device.writes == []


async def test_an_activation_under_way_is_waited_for_and_not_restarted() -> None:
    device = Robotiq(is_active=False)
    device._write(bytes([1, 0, 0, 0, 0, 0]))
    device.writes.clear()
    async with gripper_on(device) as gripper:
        assert (await gripper.activate()).is_activated
    assert device.writes == []


async def test_an_activation_that_fails_names_the_fault_and_the_remedy() -> None:
    device = Robotiq(is_active=False, activation_reads=100)
    async with gripper_on(device) as gripper:
        activating = asyncio.create_task(gripper.activate())
        await until(lambda: bytes([1, 0, 0, 0, 0, 0]) in device.writes)
        device.fault = 0x0D
        with pytest.raises(FaultError, match=r"fault 0D.*free the fingers") as caught:
            await activating
    assert caught.value.code == 0x0D


async def test_an_activation_that_never_ends_is_given_up() -> None:
    device = Robotiq(is_active=False)
    async with gripper_on(device, clock=IMPATIENT) as gripper:
        device.frozen = True
        with pytest.raises(StalledError, match=r"activation not finished after 5 s"):
            await gripper.activate()


async def test_a_major_fault_is_left_by_activating_again() -> None:
    device = Robotiq(fault=0x0E)
    async with gripper_on(device) as gripper:
        with pytest.raises(FaultError, match="over-current"):
            await gripper.open_to(40.0)
        assert device.writes == []
        await gripper.activate()
        assert device.writes == [bytes(6), bytes([1, 0, 0, 0, 0, 0])]
        await gripper.open_to(40.0)


async def test_cancelling_an_activation_deactivates() -> None:
    device = Robotiq(is_active=False)
    async with gripper_on(device) as gripper:
        device.frozen = True
        activating = asyncio.create_task(gripper.activate())
        await until(lambda: device.action == 0x01)
        activating.cancel()
        with pytest.raises(asyncio.CancelledError):
            await activating
        assert device.action == 0


async def test_a_stop_ends_an_activation_and_the_next_one_begins_anew() -> None:
    device = Robotiq(is_active=False, activation_reads=1000)
    async with gripper_on(device) as gripper:
        activating = asyncio.create_task(gripper.activate())
        await until(lambda: device.action == 0x01)
        await gripper.stop()
        with pytest.raises(StoppedError):
            await activating
        assert device.action == 0
        device.writes.clear()
        again = asyncio.create_task(gripper.activate())
        await until(lambda: device.action == 0x01)
        again.cancel()
        assert device.writes[-1] == bytes([1, 0, 0, 0, 0, 0])
        await asyncio.gather(again, return_exceptions=True)


async def test_a_moxa_at_the_address_is_the_wrong_device() -> None:
    moxa = Map(discrete=dict.fromkeys(range(6), False))
    bus = Bus({9: moxa.answer})
    async with link_to(bus) as link:
        with pytest.raises(WrongDeviceError) as caught:
            await Gripper(link).connect()
    message = str(caught.value)
    assert "expected a Robotiq 2F" in message
    assert "exception 02" in message
    assert "check slave id" in message


@pytest.mark.parametrize("first", [0x0600, 0x2100])  # a reserved bit; gSTA 2 does not exist
async def test_registers_that_no_robotiq_has_are_the_wrong_device(first: int) -> None:
    other = Map(holding={0x07D0: first, 0x07D1: 0, 0x07D2: 0})
    async with link_to(Bus({9: other.answer})) as link:
        with pytest.raises(WrongDeviceError, match="have no meaning"):
            await Gripper(link).connect()


async def test_nobody_behind_the_gateway_names_gateway_unit_and_what_to_check() -> None:
    async with link_to(Bus(gateway_code=0x0B)) as link:
        with pytest.raises(ReplyTimeoutError) as caught:
            await Gripper(link).connect()
    message = str(caught.value)
    assert "unit 9" in message
    assert str(link.address) in message
    assert "24 V supply" in message


# --- moving ---


async def test_width_speed_and_force_become_counts_at_the_calibrated_scales() -> None:
    device = Robotiq()
    async with gripper_on(device) as gripper:
        await gripper.open_to(34.0, speed_mm_s=46.0, force_n=192.0)
    # 230 - 34 * 227 / 85 = 139.2; 255 * 26 / 130 = 51; 255 * 172 / 215 = 204
    assert device.writes == [bytes([0x09, 0, 0, 139, 51, 204])]


@pytest.mark.parametrize(
    ("opening_mm", "speed_mm_s", "force_n", "words_of_it"),
    [
        (86.0, 80.0, 60.0, "0..85 mm"),
        (-1.0, 80.0, 60.0, "0..85 mm"),
        (40.0, 19.0, 60.0, "20..150 mm/s"),
        (40.0, 80.0, 236.0, "20..235 N"),
        (float("nan"), 80.0, 60.0, "mm"),
    ],
)
async def test_what_the_gripper_cannot_do_is_refused_before_the_wire(
    opening_mm: float, speed_mm_s: float, force_n: float, words_of_it: str
) -> None:
    device = Robotiq()
    async with gripper_on(device) as gripper:
        with pytest.raises(ValueError, match=words_of_it):
            await gripper.open_to(opening_mm, speed_mm_s, force_n)
    assert device.writes == []


async def test_a_part_between_the_jaws_is_detected_with_its_width() -> None:
    device = Robotiq(part_outside=150)
    async with gripper_on(device) as gripper:
        grasp = await gripper.close_on(30.0)
    assert grasp.object_detected
    assert grasp.evidence is GraspEvidence.CONTACT
    assert grasp.opening_mm == pytest.approx(80 * 85 / 227)  # (230 - 150) counts
    assert grasp.status.object is ObjectState.CONTACT_CLOSING


async def test_a_missing_part_is_a_result_and_the_jaws_stop_short_of_closing() -> None:
    device = Robotiq()
    async with gripper_on(device) as gripper:
        grasp = await gripper.close_on(30.0)
        assert not grasp.object_detected
        assert await gripper.hold() is Hold.NOTHING
    assert grasp.opening_mm == pytest.approx(22.0, abs=85 / 227)  # 8 mm beyond the part


async def test_closing_on_nothing_without_a_width_ends_at_the_closed_stop() -> None:
    device = Robotiq()
    async with gripper_on(device) as gripper:
        grasp = await gripper.close_on()
    assert not grasp.object_detected
    assert grasp.opening_mm == pytest.approx(0.0)


async def test_fingers_that_touch_each_other_are_no_part() -> None:
    device = Robotiq(part_outside=230)
    async with gripper_on(device) as gripper:
        assert not (await gripper.close_on()).object_detected


async def test_a_soft_part_that_contact_misses_is_found_by_its_width() -> None:
    device = Robotiq(part_outside=150, misses_contact=True)
    async with gripper_on(device) as gripper:
        assert (await gripper.close_on(30.0)).evidence is GraspEvidence.OPENING


async def test_a_ring_is_held_from_within() -> None:
    device = Robotiq(position=200, part_inside=90)
    async with gripper_on(device) as gripper:
        grasp = await gripper.open_on(52.0)
        assert grasp.object_detected
        assert grasp.opening_mm == pytest.approx(140 * 85 / 227)
        assert await gripper.hold() is Hold.HELD


async def test_an_obstacle_while_opening_is_a_stall_with_the_place() -> None:
    device = Robotiq(position=200, part_inside=90)
    async with gripper_on(device) as gripper:
        with pytest.raises(StalledError, match=r"met an obstacle at 52\.4 mm"):
            await gripper.open_to(85.0)


async def test_the_old_object_state_is_not_believed_before_the_request_is_echoed() -> None:
    device = Robotiq(position=120, part_outside=120)
    stale: list[bytes] = []

    def answer(pdu: bytes) -> bytes | None:
        reply = device.answer(pdu)
        if pdu[0] == 16:  # for two reads the inputs are as they were: not refreshed yet
            stale.extend([bytes([3, 6, 0xB9, 0, 0, 255, 120, 0])] * 2)
        elif stale and pdu[0] == 3:
            return stale.pop()
        return reply

    async with link_to(Bus({9: answer})) as link, Gripper(link) as gripper:
        status = await gripper.open_to(85.0)
    assert status.object is ObjectState.AT_POSITION
    assert status.opening_mm == pytest.approx(85.0)


async def test_jaws_that_never_arrive_are_stopped_and_reported() -> None:
    device = Robotiq()
    async with gripper_on(device, clock=IMPATIENT) as gripper:
        device.frozen = True
        with pytest.raises(StalledError, match=r"not arrived after .* s, stopped at 85\.0 mm"):
            await gripper.close_on(speed_mm_s=150.0)
    assert device.action == 0x01


async def test_cancelling_a_move_stops_the_jaws_before_it_returns() -> None:
    device = Robotiq(counts_per_read=1)
    async with gripper_on(device) as gripper:
        closing = asyncio.create_task(gripper.close_on())
        await until(lambda: device.position > 5)
        closing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await closing
        assert device.action == 0x01
        stopped_at = device.position
        await gripper.status()
        assert device.position == stopped_at < 230


async def test_the_stop_of_a_twice_cancelled_move_is_sent_all_the_same() -> None:
    device = Robotiq(counts_per_read=1)
    bus = Bus({9: device.answer})
    async with link_to(bus) as link:
        async with Gripper(link) as gripper:
            closing = asyncio.create_task(gripper.close_on())
            await until(lambda: device.position > 5)
            closing.cancel()
            await asyncio.sleep(0)
            closing.cancel()
            await asyncio.wait({closing})
        assert device.action == 0x01


async def test_stop_ends_a_move_and_the_mover_is_told() -> None:
    device = Robotiq(counts_per_read=1)
    async with gripper_on(device) as gripper:
        closing = asyncio.create_task(gripper.close_on())
        await until(lambda: device.position > 5)
        status = await gripper.stop()
        assert not status.is_going
        with pytest.raises(StoppedError):
            await closing


async def test_stop_does_not_start_an_activation() -> None:
    device = Robotiq(is_active=False)
    async with gripper_on(device) as gripper:
        await gripper.stop()
    assert device.writes == []


async def test_a_stop_whose_acknowledge_is_lost_is_confirmed_by_reading() -> None:
    device = Robotiq(position=100, part_outside=100)
    device.outputs[:] = bytes([9, 0, 0, 255, 0, 0])
    bus = Bus({9: device.answer})
    async with link_to(bus, "rtu", IMPATIENT) as link, Gripper(link) as gripper:
        bus.troubles = ["silent"]
        assert not (await gripper.stop()).is_going


async def test_a_move_whose_acknowledge_is_lost_is_looked_at_and_not_repeated() -> None:
    device = Robotiq(part_outside=150)
    bus = Bus({9: device.answer})
    async with link_to(bus, "rtu", IMPATIENT) as link, Gripper(link) as gripper:
        bus.troubles = [None, "silent"]  # the status before it, then the move
        assert (await gripper.close_on(30.0)).object_detected
    assert len(device.writes) == 1


async def test_a_move_that_never_reached_the_gripper_is_sent_again_after_looking() -> None:
    device = Robotiq(part_outside=150)
    bus = Bus({9: device.answer})
    lost = 0

    def answer(pdu: bytes) -> bytes | None:
        nonlocal lost
        if pdu[0] == 16 and not lost:
            lost += 1
            return None
        return device.answer(pdu)

    bus.units[9] = answer
    async with link_to(bus, "rtu", IMPATIENT) as link, Gripper(link) as gripper:
        assert (await gripper.close_on(30.0)).object_detected
    assert lost == 1
    assert len(device.writes) == 1


@pytest.mark.parametrize("code", [5, 6])
async def test_a_move_that_is_answered_later_is_sent_again_while_it_is_missing(code: int) -> None:
    device = Robotiq(part_outside=150)
    bus = Bus({9: device.answer})
    async with link_to(bus, "rtu", FAST) as link, Gripper(link) as gripper:
        bus.troubles = [None, code, None, code]  # status, move, look, move
        assert (await gripper.close_on(30.0)).object_detected
    assert len(device.writes) == 1


async def test_a_move_that_is_answered_later_is_not_sent_again_after_a_stop() -> None:
    device = Robotiq(part_outside=150)
    bus = Bus({9: device.answer})
    stops: list[asyncio.Future[object]] = []
    async with link_to(bus, "rtu", FAST) as link, Gripper(link) as gripper:

        def answer(pdu: bytes) -> bytes | None:
            if pdu[0] == 16:
                stops.append(asyncio.ensure_future(gripper.stop()))
                return bytes([pdu[0] | 0x80, 6])
            return device.answer(pdu)

        bus.units[9] = answer
        with pytest.raises(StoppedError):
            await gripper.close_on(30.0)
        await asyncio.gather(*stops)
    assert len(stops) == 1  # the move went out once


async def test_a_fault_during_a_move_is_raised_with_its_code() -> None:
    device = Robotiq(counts_per_read=1)
    async with gripper_on(device) as gripper:
        closing = asyncio.create_task(gripper.close_on())
        await until(lambda: device.position > 5)
        device.fault = 0x0A
        with pytest.raises(FaultError, match="24 V") as caught:
            await closing
    assert caught.value.code == 0x0A


async def test_power_lost_during_a_move_is_a_lost_position() -> None:
    device = Robotiq(counts_per_read=1)
    async with gripper_on(device) as gripper:
        closing = asyncio.create_task(gripper.close_on())
        await until(lambda: device.position > 5)
        device.lose_power()
        with pytest.raises(PositionLostError):
            await closing
        assert device.writes[-1][0] == 0x09  # and nothing was sent that would move it


async def test_fault_09_after_an_idle_second_does_not_stand_in_the_way() -> None:
    device = Robotiq(fault=0x09)
    async with gripper_on(device) as gripper:
        status = await gripper.open_to(40.0)
        assert status.fault == 0x09
        assert not status.has_fault
        assert "no communication for 1 s" in status.fault_text


async def test_what_the_host_missed_before_a_move_is_no_part_of_its_deadline() -> None:
    class Late(CellClock):
        def attended_s(self) -> float:
            return super().attended_s() - 60.0 * self.speed

    clock = Late(speed=20.0, min_timeout_wall_s=1.0)
    async with link_to(Bus({9: Robotiq().answer}), clock=clock) as link, Gripper(link) as gripper:
        assert (await gripper.open_to(20.0)).opening_mm == pytest.approx(20.0, abs=0.5)


# --- keeping awake, losing a part ---


async def test_an_idle_gripper_is_asked_at_least_every_half_second() -> None:
    device = Robotiq()
    clock = CellClock(speed=10.0, min_timeout_wall_s=1.0)
    at_s: list[float] = []

    def answer(pdu: bytes) -> bytes | None:
        at_s.append(clock.attended_s())
        return device.answer(pdu)

    async with (
        clock.attending(),
        link_to(Bus({9: answer}), clock=clock) as link,
        Gripper(link),
    ):
        await until(lambda: len(at_s) >= 8)
    gaps_s = [later - earlier for earlier, later in itertools.pairwise(at_s)]
    assert 0.3 < statistics.median(gaps_s) <= 0.55  # what the host missed does not count


async def test_a_part_that_slips_away_is_noticed_without_being_asked_for() -> None:
    device = Robotiq(part_outside=150)
    async with gripper_on(device) as gripper:
        assert (await gripper.close_on(30.0)).object_detected
        assert await gripper.hold() is Hold.HELD
        device.part_outside = None
        async with asyncio.timeout(600):
            await gripper.wait_lost()
        assert await gripper.hold() is Hold.LOST
        await gripper.open_to(85.0)
        assert await gripper.hold() is Hold.NOTHING


async def test_a_part_that_turns_between_the_jaws_counts_as_lost() -> None:
    device = Robotiq(part_outside=150)
    async with gripper_on(device) as gripper:
        await gripper.close_on(30.0)
        device.part_outside = 158  # contact again, but 3 mm narrower
        async with asyncio.timeout(600):
            await gripper.wait_lost()


async def test_contact_that_ends_without_the_jaws_moving_is_a_loss() -> None:
    device = Robotiq(part_outside=150)
    async with gripper_on(device) as gripper:
        await gripper.close_on(30.0)
        device.misses_contact = True  # gOBJ 3 at the same width: "or the object was lost"
        assert await gripper.hold() is Hold.LOST


async def test_a_stopped_gripper_still_holds() -> None:
    device = Robotiq(part_outside=150)
    async with gripper_on(device) as gripper:
        await gripper.close_on(30.0)
        await gripper.stop()
        assert await gripper.hold() is Hold.HELD


async def test_after_a_power_loss_nobody_claims_to_know_what_is_held() -> None:
    device = Robotiq(part_outside=150)
    async with gripper_on(device) as gripper:
        await gripper.close_on(30.0)
        device.lose_power()
        assert await gripper.hold() is Hold.UNKNOWN


async def test_the_keep_alive_outlives_a_lost_connection() -> None:
    device = Robotiq()
    bus = Bus({9: device.answer})
    async with link_to(bus) as link, Gripper(link) as gripper:
        bus.cut()
        before = gripper.latest
        assert before is not None
        await until(lambda: gripper.latest is not None and gripper.latest.at_s > before.at_s)
    assert bus.connection_count == 2


async def test_closing_the_driver_ends_its_task_and_moves_nothing() -> None:
    device = Robotiq()
    async with gripper_on(device) as gripper:
        assert any("keep-alive" in task.get_name() for task in asyncio.all_tasks())
        await gripper.aclose()
        assert not any("keep-alive" in task.get_name() for task in asyncio.all_tasks())
    assert device.writes == []


async def test_a_reading_says_when_it_was_taken() -> None:
    async with gripper_on(Robotiq()) as gripper:
        before_s = FAST.now_s()
        status = await gripper.status()
        assert before_s <= status.at_s <= FAST.now_s()
        assert status.activation is ActivationState.ACTIVE


def test_a_configuration_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="counts must rise"):
        GripperConfig(counts_open=230, counts_closed=3)
    with pytest.raises(ValueError, match="keep_alive_s"):
        GripperConfig(keep_alive_s=0.9)
    with pytest.raises(ValueError, match="speed must be"):
        GripperConfig(default_speed_mm_s=500.0)


async def test_a_gripper_that_falls_silent_during_a_move_is_a_link_error() -> None:
    device = Robotiq(counts_per_read=1)
    bus = Bus({9: device.answer})
    async with link_to(bus, clock=IMPATIENT) as link, Gripper(link) as gripper:
        closing = asyncio.create_task(gripper.close_on())
        await until(lambda: device.position > 5)
        bus.silent_units.add(9)
        with pytest.raises(LinkError, match="no answer from unit 9"):
            await closing


def test_the_fake_speaks_the_worked_frames() -> None:
    """The fake is only worth something if it agrees with the manual as well."""
    device = Robotiq(position=0xBD, part_outside=0xBD)
    device.answer(golden("robotiq", "close_fully")[0][1:-2])
    request, reply = golden("robotiq", "status_gripped")
    assert device.answer(request[1:-2]) == reply[1:-2]
    assert words(0xB900) == reply[3:5]
