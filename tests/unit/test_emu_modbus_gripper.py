"""Robotiq 2F-85 emulator: modbus_devices.md 2.1 to 2.9, beyond the frames printed there.

Sections (§) are those of modbus_devices.md.
"""

import pytest
from emu_modbus_bench import STEP_S
from hypothesis import given
from hypothesis import strategies as st

from emulators.gripper_modbus import Fault, JawModel, RobotiqConfig, RobotiqDevice

RESET, ACTIVATING, ACTIVE = 0, 1, 3
MOVING, CONTACT_OPENING, CONTACT_CLOSING, AT_POSITION = 0, 1, 2, 3
COUNT_MM = 85 / (230 - 3)  # §2.5: 3 open, 230 closed


class Bench:
    """A master that writes and reads registers, and the world's clock."""

    def __init__(self, **config: float) -> None:
        self.device = RobotiqDevice(config=RobotiqConfig(**config))  # type: ignore[arg-type] # floats only
        self.jaws = self.device.jaws

    def write(self, action: int, position: int = 0, speed: int = 0xFF, force: int = 0xFF) -> None:
        pdu = bytes.fromhex("10 03E8 0003 06") + bytes((action, 0, 0, position, speed, force))
        assert self.device.request(pdu, 0.0) == bytes.fromhex("10 03E8 0003")

    def read(self) -> bytes:
        reply = self.device.request(bytes.fromhex("03 07D0 0003"), 0.0)
        assert reply is not None
        assert reply[:2] == b"\x03\x06"
        return reply[2:]

    def wait(self, duration_s: float, *, is_polled: bool = True) -> None:
        for step in range(round(duration_s / STEP_S)):
            self.device.advance(STEP_S)
            if is_polled and step % 48 == 0:
                self.read()

    @property
    def status(self) -> int:
        return self.read()[0] >> 4 & 3

    @property
    def object(self) -> int:
        return self.read()[0] >> 6

    @property
    def fault(self) -> int:
        return self.read()[2]

    @property
    def counts(self) -> int:
        return self.read()[4]

    def activate(self) -> "Bench":
        self.write(0x00)
        self.write(0x01)
        self.wait(1.6)
        assert self.status == ACTIVE
        return self


@pytest.fixture
def bench() -> Bench:
    return Bench().activate()


# --- activation -----------------------------------------------------------------------------------


def test_activation_takes_its_time_and_moves_the_fingers() -> None:
    bench = Bench(activation_s=1.0)
    bench.write(0x00)
    bench.write(0x01)
    bench.wait(0.05)
    assert bench.status == ACTIVATING
    seen = []
    for _ in range(19):
        bench.wait(0.05)
        seen.append(bench.jaws.opening_mm)
    assert min(seen) < 5.0
    bench.wait(0.1)
    assert bench.status == ACTIVE
    assert bench.jaws.opening_mm == pytest.approx(85.0, abs=0.02)


def test_after_power_up_the_activation_bit_must_be_cleared_first() -> None:
    bench = Bench()
    bench.write(0x01)
    bench.wait(3.0)
    assert bench.status == RESET
    bench = Bench()
    assert bench.device.request(bytes.fromhex("06 03E9 0000"), 0.0) is not None
    bench.write(0x01)
    bench.wait(3.0)
    assert bench.status == RESET  # a position of 0 is not an activation bit of 0
    bench.activate()
    bench.device.is_powered = False
    assert bench.device.request(bytes.fromhex("03 07D0 0003"), 0.0) is None
    bench.device.is_powered = True
    bench.write(0x01)
    bench.wait(3.0)
    assert bench.status == RESET


def test_activating_an_active_gripper_again_needs_an_edge(bench: Bench) -> None:
    bench.write(0x01)
    bench.wait(0.05)
    assert bench.status == ACTIVE
    bench.write(0x00)
    bench.wait(0.05)
    assert bench.status == RESET
    bench.write(0x01)
    bench.wait(0.05)
    assert bench.status == ACTIVATING


def test_activation_drops_what_is_held(bench: Bench) -> None:
    bench.jaws.grasp_limit_mm = 40.0
    bench.write(0x09, 0xFF)
    bench.wait(1.0)
    assert bench.jaws.is_holding
    bench.write(0x00)
    bench.write(0x01)
    bench.wait(0.05)
    assert bench.jaws.force_n == 0.0
    assert bench.jaws.opening_mm > 40.0


def test_activation_with_something_between_the_jaws_is_fault_0d() -> None:
    bench = Bench()
    bench.jaws.grasp_limit_mm = 30.0
    bench.write(0x00)
    bench.write(0x01)
    bench.wait(2.0)
    assert bench.fault == Fault.ACTIVATION_FAILED
    assert bench.status == ACTIVATING
    bench.jaws.grasp_limit_mm = None
    assert bench.activate().fault == Fault.NONE


def test_a_move_asked_during_activation_is_fault_05_and_comes_afterwards() -> None:
    bench = Bench(activation_s=1.0)
    bench.write(0x00)
    bench.write(0x01)
    bench.wait(0.1)
    bench.write(0x09, 0xFF)
    bench.wait(0.1)
    assert bench.fault == 0x05
    assert bench.status == ACTIVATING
    bench.wait(2.0)
    assert bench.fault == 0
    assert (bench.object, bench.counts) == (AT_POSITION, 230)


def test_a_move_without_activation_is_fault_07_until_activation() -> None:
    bench = Bench()
    bench.write(0x08, 0xFF)
    bench.wait(0.5)
    assert bench.fault == 0x07
    assert bench.jaws.opening_mm == 85.0
    assert bench.activate().fault == 0


# --- moves ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("speed", "mm_per_s"), [(0, 20.0), (255, 150.0), (128, 20 + 130 * 128 / 255)]
)
def test_the_jaws_move_at_the_mapped_speed(bench: Bench, speed: int, mm_per_s: float) -> None:
    bench.write(0x09, 0xFF, speed)
    bench.wait(0.4)
    moved_mm = 85.0 - bench.jaws.opening_mm
    assert moved_mm == pytest.approx(0.4 * mm_per_s, abs=1.1 * STEP_S * mm_per_s)
    assert bench.object == MOVING


@given(position=st.integers(0, 255))
def test_a_position_is_reached_within_its_ends(position: int) -> None:
    bench = Bench(activation_s=0.1)
    bench.write(0x00)
    bench.write(0x01)
    bench.wait(0.2)
    bench.write(0x09, position)
    bench.wait(0.7)
    assert bench.counts == min(max(position, 3), 230)
    assert bench.object == AT_POSITION


def test_a_new_position_starts_at_once_and_needs_rgto(bench: Bench) -> None:
    position_only = bytes.fromhex("06 03E9 0080")
    assert bench.device.request(position_only, 0.0) == position_only
    bench.wait(0.2)
    assert bench.jaws.opening_mm == pytest.approx(85.0, abs=0.02)
    bench.write(0x09, 0x00)
    assert bench.device.request(position_only, 0.0) == position_only
    bench.wait(1.0)
    assert bench.counts == 0x80


def test_stopping_freezes_the_jaws_half_way(bench: Bench) -> None:
    bench.write(0x09, 0xFF)
    bench.wait(0.2)
    bench.write(0x01, 0xFF)
    bench.wait(0.01)
    stopped_mm = bench.jaws.opening_mm
    bench.wait(0.5)
    assert 0.0 < stopped_mm < 85.0
    assert bench.jaws.opening_mm == stopped_mm
    assert bench.read()[0] == 0x31  # gGTO 0 is echoed


def test_a_status_may_be_one_refresh_old_but_fc23_reads_its_own_write() -> None:
    bench = Bench().activate()
    bench.wait(STEP_S * 2)
    bench.write(0x09, 0x80)
    assert bench.read()[3] == 0x00  # gPR of before: §2.6 warns of it
    bench.wait(STEP_S * 2)
    assert bench.read()[3] == 0x80
    both = bench.device.request(bytes.fromhex("17 07D0 0003 03E8 0003 06 0900 0040 FFFF"), 0.0)
    assert both is not None
    assert both[5] == 0x40


# --- parts between the jaws -----------------------------------------------------------------------


@pytest.mark.parametrize("width_mm", [5.0, 28.0, 60.0])
@pytest.mark.parametrize(("force", "newtons"), [(0, 20.0), (255, 235.0)])
def test_a_part_stops_the_jaws_and_feels_their_force(
    bench: Bench, width_mm: float, force: int, newtons: float
) -> None:
    bench.jaws.grasp_limit_mm = width_mm
    bench.write(0x09, 0xFF, 0xFF, force)
    bench.wait(1.0)
    assert bench.object == CONTACT_CLOSING
    assert bench.jaws.opening_mm == pytest.approx(width_mm)
    assert bench.counts == pytest.approx(230 - width_mm / COUNT_MM, abs=0.51)
    assert bench.jaws.is_pressing
    assert bench.jaws.force_n == pytest.approx(newtons)


def test_a_lost_part_lets_the_jaws_go_on_to_where_they_were_sent(bench: Bench) -> None:
    bench.jaws.grasp_limit_mm = 40.0
    bench.write(0x09, 0xFF)
    bench.wait(1.0)
    assert bench.object == CONTACT_CLOSING
    bench.jaws.grasp_limit_mm = None
    bench.wait(0.05)
    assert bench.object == MOVING
    assert bench.jaws.force_n == 0.0
    bench.wait(1.0)
    assert (bench.object, bench.counts) == (AT_POSITION, 230)


def test_a_part_that_gives_way_a_little_stays_gripped(bench: Bench) -> None:
    bench.jaws.grasp_limit_mm = 40.0
    bench.write(0x09, 0xFF)
    bench.wait(1.0)
    for _ in range(100):
        bench.jaws.grasp_limit_mm -= 0.02
        bench.wait(STEP_S)
        assert bench.object == CONTACT_CLOSING
    assert bench.jaws.opening_mm == pytest.approx(38.0)


def test_a_part_as_wide_as_asked_is_a_position_reached(bench: Bench) -> None:
    # gOBJ 3 says "no object or lost": a driver must ask for less than the part's width (§2.3)
    bench.jaws.grasp_limit_mm = (230 - 0x80) * COUNT_MM
    bench.write(0x09, 0x80)
    bench.wait(1.0)
    assert bench.object == AT_POSITION


def test_a_stopped_gripper_keeps_its_hold_and_a_dead_one_too(bench: Bench) -> None:
    bench.jaws.grasp_limit_mm = 40.0
    bench.write(0x09, 0xFF)
    bench.wait(1.0)
    bench.write(0x01, 0xFF)
    bench.wait(0.5)
    assert bench.jaws.force_n == pytest.approx(235.0)
    bench.device.is_powered = False
    bench.wait(0.5, is_polled=False)
    assert bench.jaws.force_n == pytest.approx(235.0)
    bench.jaws.grasp_limit_mm = None
    bench.device.advance(STEP_S)
    assert (bench.jaws.force_n, bench.jaws.opening_mm) == (0.0, pytest.approx(40.0))


def test_opening_inside_a_ring_is_contact_while_opening(bench: Bench) -> None:
    bench.write(0x09, 0xFF)
    bench.wait(1.0)
    bench.jaws.inner_limit_mm = 50.0
    bench.write(0x09, 0x00)
    bench.wait(1.0)
    assert bench.object == CONTACT_OPENING
    assert bench.jaws.opening_mm == pytest.approx(50.0)
    bench.jaws.inner_limit_mm = None
    bench.wait(1.0)
    assert bench.object == AT_POSITION


def test_a_part_wider_than_the_gap_is_not_crushed_nor_pushes_the_jaws() -> None:
    jaws = JawModel(opening_mm=30.0)
    jaws.grasp_limit_mm = 31.0
    jaws.drive(0.0, 150.0, 100.0)
    jaws.advance(STEP_S)
    assert jaws.opening_mm == 30.0
    assert jaws.is_pressing


# --- faults ---------------------------------------------------------------------------------------


def test_a_second_of_silence_is_fault_09_in_the_next_reply_only(bench: Bench) -> None:
    bench.wait(0.99, is_polled=False)
    assert bench.fault == 0
    bench.wait(1.01, is_polled=False)
    assert bench.fault == 0x09
    bench.wait(STEP_S * 2)
    assert bench.fault == 0
    assert bench.status == ACTIVE


def test_requests_it_does_not_understand_do_not_count_as_communication(bench: Bench) -> None:
    for _ in range(6):
        bench.wait(0.2, is_polled=False)
        assert bench.device.request(bytes.fromhex("03 0000 0001"), 0.0) is None
    assert bench.fault == 0x09


@pytest.mark.parametrize(("direction", "end_counts"), [(0x11, 230), (0x31, 3)])
def test_automatic_release_is_slow_then_0f_until_activated_again(
    bench: Bench, direction: int, end_counts: int
) -> None:
    bench.write(0x09, 0x80)
    bench.wait(1.0)
    bench.write(direction)
    bench.wait(0.5)
    away_mm = abs(bench.counts - 0x80) * COUNT_MM
    assert away_mm == pytest.approx(0.5 * 20.0, abs=0.5)
    assert (bench.fault, bench.status) == (0x0B, RESET)
    bench.write(0x09, 0x80)  # everything but rACT is overridden
    bench.wait(4.0)
    assert (bench.fault, bench.status, bench.counts) == (0x0F, RESET, end_counts)
    assert bench.activate().fault == 0


@pytest.mark.parametrize("code", [0x0A, 0x0C, 0x0D, 0x0E])
def test_a_major_fault_stops_the_jaws_until_the_activation_bit_goes_0_and_1(
    bench: Bench, code: int
) -> None:
    bench.write(0x09, 0xFF)
    bench.wait(0.2)
    bench.device.raise_fault(code)
    stopped_mm = bench.jaws.opening_mm
    bench.write(0x09, 0x00)
    bench.wait(0.5)
    assert bench.fault == code
    assert bench.jaws.opening_mm == stopped_mm
    assert bench.activate().fault == 0


def test_only_codes_of_the_page_can_be_raised(bench: Bench) -> None:
    with pytest.raises(ValueError, match="6"):
        bench.device.raise_fault(0x06)


def test_a_hot_gripper_shows_08_and_works_on(bench: Bench) -> None:
    bench.device.is_over_temperature = True
    bench.write(0x09, 0xFF)
    bench.wait(1.0)
    assert (bench.fault, bench.counts) == (0x08, 230)
    bench.device.is_over_temperature = False
    bench.wait(0.1)
    assert bench.fault == 0


def test_jammed_fingers_feel_like_a_part(bench: Bench) -> None:
    bench.jaws.jammed = True
    bench.write(0x09, 0xFF)
    bench.wait(0.5)
    assert (bench.object, bench.counts) == (CONTACT_CLOSING, 3)


# --- the wire -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "pdu",
    [
        "03 07CF 0001",
        "03 07D0 0004",
        "03 07D3 0001",
        "03 07D0 0000",
        "03 03E8 0001",
        "03 07D0",
        "06 07D0 0001",
        "06 03F0 0001",
        "06 03E8 01",
        "10 03E7 0001 02 0000",
        "10 03EF 0002 04 0000 0000",
        "10 03E8 0001 04 0000 0000",
        "10 03E8 0002 04 0000",
        "17 07D0 0004 03E8 0001 02 0900",
        "17 07D0 0003 03F0 0001 02 0900",
        "01 0000 0001",
        "07",
        "42",
    ],
)
def test_what_it_does_not_know_it_does_not_answer_nor_do(bench: Bench, pdu: str) -> None:
    before = bench.read()
    assert bench.device.request(bytes.fromhex(pdu), 0.0) is None
    bench.wait(0.1)
    assert bench.read() == before


@given(st.binary(min_size=1, max_size=253))
def test_no_request_whatever_makes_an_exception(pdu: bytes) -> None:
    reply = RobotiqDevice().request(pdu, 0.0)
    assert reply is None or (reply[0] == pdu[0] and reply[0] in {3, 4, 6, 0x10, 0x17})


def test_reserved_registers_are_taken_and_ignored(bench: Bench) -> None:
    full = bytes.fromhex("10 03E8 0008 10 0955 5580 FFFF") + b"\x55" * 10
    assert bench.device.request(full, 0.0) == bytes.fromhex("10 03E8 0008")
    bench.wait(1.0)
    assert bench.read() == bytes((0xF9, 0, 0, 0x80, 0x80, 0))
