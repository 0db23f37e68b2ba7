"""The gripper's driver and the emulated Robotiq over each of the three ways to its RS-485 line.

Sections (§) are those of modbus_devices.md.
"""

import asyncio
import itertools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from cross_bench import HANG_WALL_S, nothing_is_left, open_fds, until
from modbus_bench import ModbusBench, Transport, modbus_bench

from drivers.errors import (
    FaultError,
    LinkError,
    PositionLostError,
    ReplyTimeoutError,
    StalledError,
    WrongDeviceError,
)
from drivers.gripper_modbus import Gripper, GripperConfig, Hold, StoppedError
from emulators.gripper_modbus import JawModel, RobotiqDevice
from emulators.io_modbus import E1214Device

LINES: tuple[Transport, ...] = ("tcp", "rtu", "rtu-tcp")
FAST_TO_BE_SILENT = ["tcp", "rtu-tcp", pytest.param("rtu", marks=pytest.mark.slow)]
ONE_COUNT_MM = 85.0 / 227  # modbus_devices.md 2.5: 3 to 230 counts over the stroke
UNIT = 9
# modbus_devices.md 2.7, PDUs of its printed frames: FC16 of 3 registers from 03E8
CLEAR = bytes.fromhex("10 03E8 0003 06 0000 0000 0000")
ACTIVATE = bytes.fromhex("10 03E8 0003 06 0100 0000 0000")
STOP = bytes.fromhex("06 03E8 0100")


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


class Bench:
    """A gripper on a line, and its driver."""

    def __init__(self, line: ModbusBench, device: RobotiqDevice, gripper: Gripper) -> None:
        self.line, self.device, self.gripper = line, device, gripper
        self.jaws = device.jaws

    def writes(self) -> list[bytes]:
        """PDUs of all writes the driver has sent, whatever frame was around them."""
        tcp = self.line.server.__class__.__name__ == "TcpGateway"
        pdus = [frame[7:] if tcp else frame[1:-2] for frame in self.line.sent()]
        return [pdu for pdu in pdus if pdu[0] in (0x06, 0x10)]

    async def active(self) -> "Bench":
        await self.gripper.connect()
        await self.gripper.activate()
        self.line.trace.clear()
        return self


@asynccontextmanager
async def gripper_bench(
    transport: Transport, folder: Path, *, speed: float = 20.0
) -> AsyncIterator[Bench]:
    device = RobotiqDevice(JawModel(), UNIT)
    async with modbus_bench(transport, [device], [device], folder, speed=speed) as line:
        gripper = Gripper(line.link)
        try:
            yield Bench(line, device, gripper)
        finally:
            await gripper.aclose()


@pytest.fixture(params=LINES)
async def bench(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[Bench]:
    async with gripper_bench(request.param, tmp_path) as bench:
        yield bench


@pytest.fixture
async def by_gateway(tmp_path: Path) -> AsyncIterator[Bench]:
    """What the line is does not matter."""
    async with gripper_bench("tcp", tmp_path) as bench:
        yield bench


@pytest.fixture
def transport() -> Transport:
    return "tcp"


@pytest.fixture
async def impatient(transport: Transport, tmp_path: Path) -> AsyncIterator[Bench]:
    async with gripper_bench(transport, tmp_path) as bench:
        yield await bench.active()


# ---- activation ----------------------------------------------------------------------------------
async def test_connecting_moves_nothing_and_activating_clears_first(bench: Bench) -> None:
    bench.jaws.opening_mm = 40.0
    status = await bench.gripper.connect()
    assert not status.is_activated
    assert bench.jaws.opening_mm == 40.0
    with pytest.raises(PositionLostError, match="not activated"):
        await bench.gripper.open_to(60.0)
    assert bench.jaws.opening_mm == 40.0
    status = await bench.gripper.activate()
    assert status.is_activated
    assert bench.writes()[:2] == [CLEAR, ACTIVATE]
    assert bench.jaws.opening_mm == pytest.approx(85.0, abs=0.1)


async def test_a_gripper_that_holds_a_part_is_taken_over_without_activation(bench: Bench) -> None:
    await bench.active()
    bench.jaws.grasp_limit_mm = 40.0
    await bench.gripper.close_on(40.0)
    await bench.gripper.aclose()
    other = Gripper(bench.line.link)
    bench.line.trace.clear()
    try:
        status = await other.connect()
        assert status.is_activated
        await other.activate()
        assert await other.hold() is Hold.HELD
    finally:
        await other.aclose()
    assert bench.writes() == []
    assert bench.jaws.opening_mm == pytest.approx(40.0, abs=0.1)


async def test_jaws_blocked_while_activating_are_a_fault_that_activating_again_clears(
    by_gateway: Bench,
) -> None:
    await by_gateway.gripper.connect()
    by_gateway.jaws.jammed = True
    with pytest.raises(FaultError, match="activation") as fault:
        await by_gateway.gripper.activate()
    assert fault.value.code == 0x0D  # §2.4
    by_gateway.jaws.jammed = False
    assert (await by_gateway.gripper.activate()).is_activated


# ---- opening and closing -------------------------------------------------------------------------
async def test_the_jaws_open_to_the_width_that_was_asked_for(bench: Bench) -> None:
    await bench.active()
    for opening_mm in (30.0, 85.0, 62.5, 0.0):
        status = await bench.gripper.open_to(opening_mm, speed_mm_s=150.0)
        assert bench.jaws.opening_mm == pytest.approx(opening_mm, abs=ONE_COUNT_MM)
        assert status.opening_mm == pytest.approx(opening_mm, abs=ONE_COUNT_MM)


async def test_speed_and_force_are_what_was_asked_for(by_gateway: Bench) -> None:
    await by_gateway.active()
    by_gateway.jaws.grasp_limit_mm = 30.0
    await by_gateway.gripper.close_on(30.0, speed_mm_s=50.0, force_n=100.0)
    assert by_gateway.jaws.speed_mm_per_s == pytest.approx(50.0, abs=130 / 255)
    assert by_gateway.jaws.force_limit_n == pytest.approx(100.0, abs=215 / 255)


async def test_a_part_is_gripped_held_and_its_loss_is_noticed(bench: Bench) -> None:
    await bench.active()
    bench.jaws.grasp_limit_mm = 41.3
    result = await bench.gripper.close_on(41.0, force_n=60.0)
    assert result.object_detected
    assert result.opening_mm == pytest.approx(41.3, abs=ONE_COUNT_MM)
    assert bench.jaws.force_n == pytest.approx(60.0, abs=1.0)
    assert await bench.gripper.hold() is Hold.HELD
    asked_count = len(bench.line.sent())
    bench.jaws.grasp_limit_mm = None
    async with asyncio.timeout(HANG_WALL_S):
        await bench.gripper.wait_lost()
    assert len(bench.line.sent()) - asked_count <= 5  # the jaws need 0.1 s to be seen elsewhere
    assert await bench.gripper.hold() is Hold.LOST


async def test_without_a_part_a_grip_is_empty_and_no_error(by_gateway: Bench) -> None:
    await by_gateway.active()
    result = await by_gateway.gripper.close_on(40.0)
    assert not result.object_detected
    assert by_gateway.jaws.opening_mm == pytest.approx(
        32.0, abs=ONE_COUNT_MM
    )  # over-travel of 8 mm
    assert not (await by_gateway.gripper.close_on()).object_detected
    assert by_gateway.jaws.opening_mm == pytest.approx(0.0, abs=ONE_COUNT_MM)
    assert await by_gateway.gripper.hold() is Hold.NOTHING


async def test_a_ring_is_held_from_within(by_gateway: Bench) -> None:
    await by_gateway.active()
    await by_gateway.gripper.open_to(20.0, speed_mm_s=150.0)
    by_gateway.jaws.inner_limit_mm = 55.0
    result = await by_gateway.gripper.open_on(55.0)
    assert result.object_detected
    assert result.opening_mm == pytest.approx(55.0, abs=ONE_COUNT_MM)


async def test_something_in_the_way_of_an_empty_move_is_told(by_gateway: Bench) -> None:
    await by_gateway.active()
    by_gateway.jaws.grasp_limit_mm = 50.0
    with pytest.raises(StalledError, match="met an obstacle at 50"):
        await by_gateway.gripper.open_to(20.0)


async def test_a_stop_stops_the_jaws_and_says_so_to_the_move(bench: Bench) -> None:
    await bench.active()
    move = asyncio.create_task(bench.gripper.open_to(0.0, speed_mm_s=20.0))
    await until(lambda: bench.jaws.opening_mm < 80.0)
    status = await bench.gripper.stop()
    with pytest.raises(StoppedError):
        await move
    assert not status.is_going
    assert STOP in bench.writes()
    stopped_mm = bench.jaws.opening_mm
    await bench.line.pass_time(1.0)
    assert bench.jaws.opening_mm == stopped_mm > 1.0


async def test_a_stop_that_comes_before_the_jaws_have_begun_ends_the_move(bench: Bench) -> None:
    await bench.active()
    began_mm = bench.jaws.opening_mm
    move = asyncio.create_task(bench.gripper.open_to(0.0, speed_mm_s=20.0))
    await asyncio.sleep(0)  # its first reading is under way
    await bench.gripper.stop()
    with pytest.raises(StoppedError):
        await move
    await bench.line.pass_time(1.0)
    assert bench.jaws.opening_mm == pytest.approx(began_mm, abs=1.0)


async def test_a_cancelled_move_stops_the_jaws_before_it_ends(bench: Bench) -> None:
    await bench.active()
    move = asyncio.create_task(bench.gripper.open_to(0.0, speed_mm_s=20.0))
    await until(lambda: bench.jaws.opening_mm < 80.0)
    move.cancel()
    with pytest.raises(asyncio.CancelledError):
        await move
    assert not bench.jaws.is_driven


# ---- faults of the gripper -----------------------------------------------------------------------
@pytest.mark.parametrize("code", [0x0A, 0x0C, 0x0E])
async def test_a_major_fault_ends_the_move_and_activation_clears_it(
    by_gateway: Bench, code: int
) -> None:
    await by_gateway.active()
    move = asyncio.create_task(by_gateway.gripper.close_on(speed_mm_s=20.0))
    await until(lambda: by_gateway.jaws.opening_mm < 80.0)
    by_gateway.device.raise_fault(code)
    with pytest.raises(FaultError) as fault:
        await move
    assert fault.value.code == code
    with pytest.raises(FaultError):
        await by_gateway.gripper.open_to(50.0)
    await by_gateway.gripper.activate()
    await by_gateway.gripper.open_to(50.0)
    assert by_gateway.jaws.opening_mm == pytest.approx(50.0, abs=ONE_COUNT_MM)


async def test_over_temperature_passes_by_itself(by_gateway: Bench) -> None:
    await by_gateway.active()
    by_gateway.device.is_over_temperature = True
    await by_gateway.line.pass_time(0.1)
    with pytest.raises(FaultError, match="cool") as fault:
        await by_gateway.gripper.open_to(50.0)
    assert fault.value.code == 0x08
    by_gateway.device.is_over_temperature = False
    await by_gateway.line.pass_time(0.1)
    await by_gateway.gripper.open_to(50.0)


@pytest.mark.parametrize("transport", FAST_TO_BE_SILENT)
async def test_a_gripper_that_lost_its_power_is_not_moved_before_it_is_activated(
    impatient: Bench,
) -> None:
    impatient.device.is_powered = False
    with pytest.raises(ReplyTimeoutError, match="24 V supply"):
        await impatient.gripper.status()
    impatient.device.is_powered = True
    with pytest.raises(PositionLostError, match="not activated"):
        await impatient.gripper.open_to(50.0)
    assert (await impatient.gripper.activate()).is_activated


# ---- keep-alive ----------------------------------------------------------------------------------
@pytest.mark.parametrize("speed", [pytest.param(1.0, marks=pytest.mark.slow), 10.0])
async def test_the_keep_alive_keeps_fault_09_away(tmp_path: Path, speed: float) -> None:
    async with gripper_bench("tcp", tmp_path, speed=speed) as bench:
        await bench.gripper.connect()
        longest_idle_s = 0.0
        until_s = bench.line.lived_s + 2.5
        while bench.line.lived_s < until_s:
            await asyncio.sleep(0.005)
            longest_idle_s = max(longest_idle_s, bench.device._idle_s)
        assert 0.05 < longest_idle_s < 1.0  # §2.4: 09 comes after a second
        await bench.gripper.aclose()
        await bench.line.pass_time(1.2)
        assert bench.device._shown_fault() == 0x09
        status = await bench.gripper.connect()  # which is the message that ends it
        assert not status.has_fault


# ---- faults of the line --------------------------------------------------------------------------
@pytest.mark.parametrize("transport", FAST_TO_BE_SILENT)
async def test_a_silent_gripper_is_told_whichever_way_it_shows(impatient: Bench) -> None:
    """§2.8: behind a gateway as exception 0B, else as time-out; both are silence."""
    impatient.line.bus.faults(UNIT).is_deaf = True
    with pytest.raises(ReplyTimeoutError, match="check its 24 V supply"):
        await impatient.gripper.status()
    impatient.line.bus.clear_faults()
    assert (await impatient.gripper.status()).is_activated


WRONG = ("is_mute", "is_crc_bad", "is_deaf", "cut", "late")
EVERY_RUN = {
    ("tcp", "is_mute"),
    ("rtu-tcp", "is_crc_bad"),
    ("rtu-tcp", "late"),
    ("rtu-tcp", "cut"),
}


@pytest.mark.parametrize(
    ("transport", "fault"),
    [
        pytest.param(line, one, marks=() if (line, one) in EVERY_RUN else pytest.mark.slow)
        for line in LINES
        for one in WRONG
    ],
)
async def test_a_reply_that_goes_wrong_once_is_got_over(impatient: Bench, fault: str) -> None:
    """Reads are repeated; a write is looked for before it is said again."""
    bus = impatient.line.bus
    wrong: dict[str, Any] = {fault: True}
    if fault == "cut":
        wrong = {"reply_byte_count": 5}
    elif fault == "late":
        wrong = {"reply_delay_s": impatient.line.patience_s * 1.3}  # beyond all patience
    request_count = itertools.count()

    def strike() -> None:
        if next(request_count) == hit:
            faults = bus.faults(UNIT)
            for name, value in wrong.items():
                setattr(faults, name, value)
            faults.requests_left = 1

    for hit, opening_mm in enumerate((50.0, 80.0, 40.0)):  # status before, the write, a poll
        request_count = itertools.count()
        bus.before_request = strike
        await impatient.gripper.open_to(opening_mm, speed_mm_s=150.0)
        assert next(request_count) > hit
        assert impatient.jaws.opening_mm == pytest.approx(opening_mm, abs=ONE_COUNT_MM)
        bus.before_request = None
        bus.clear_faults()


@pytest.mark.parametrize("transport", [pytest.param("rtu", marks=pytest.mark.slow), "rtu-tcp"])
async def test_late_answers_are_never_taken_for_others(impatient: Bench) -> None:
    """§8.7: without a transaction number the answer to one read looks like that to the next."""
    faults = impatient.line.bus.faults(UNIT)
    for step in range(4):
        before_mm = impatient.jaws.opening_mm
        faults.reply_delay_s, faults.requests_left = impatient.line.patience_s * 1.2, 1
        status = await impatient.gripper.status()
        assert status.opening_mm == pytest.approx(before_mm, abs=ONE_COUNT_MM)
        opening_mm = (20.0, 70.0)[step % 2]
        await impatient.gripper.open_to(opening_mm, speed_mm_s=150.0)
        assert (await impatient.gripper.status()).opening_mm == pytest.approx(
            opening_mm, abs=ONE_COUNT_MM
        )


@pytest.mark.parametrize("transport", LINES)
async def test_a_line_that_comes_back_is_used_again_and_the_gripper_left_as_it_is(
    impatient: Bench,
) -> None:
    impatient.jaws.grasp_limit_mm = 35.0
    await impatient.gripper.close_on(35.0)
    await impatient.line.server.aclose()
    with pytest.raises(LinkError):
        await impatient.gripper.status()
    await impatient.line.server.start()
    impatient.line.trace.clear()
    async with asyncio.timeout(HANG_WALL_S):
        while True:
            try:
                status = await impatient.gripper.status()
                break
            except LinkError:  # its back-off is not over
                await impatient.line.clock.sleep(0.1)
    assert status.is_activated
    assert await impatient.gripper.hold() is Hold.HELD
    assert impatient.writes() == []


async def test_another_device_at_the_address_is_no_gripper(tmp_path: Path) -> None:
    device = E1214Device(unit=UNIT)
    async with modbus_bench("tcp", [device], [device], tmp_path) as line:
        gripper = Gripper(line.link, GripperConfig(unit=UNIT))
        with pytest.raises(WrongDeviceError, match="expected a Robotiq 2F"):
            await gripper.connect()
