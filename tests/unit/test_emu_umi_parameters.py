"""The arm's parameters: both dialects, checksums, refusals, labels. umi_rtx.md 2.2, 2.5, 7."""

import functools
import operator

import pytest
from emu_umi_line import Line
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.umi_scara import Axis

int16 = st.integers(-32768, 32767)
# umi_rtx.md 7, "Defaults"
DEFAULTS = {2: 1000, 4: 100, 5: 1200, 6: 20, 7: 600, 8: 2, 9: 0, 12: 20}


def checksum(value: int) -> int:
    """XOR of the four hexadecimal digits; umi_rtx.md 2.2."""
    return functools.reduce(operator.xor, (int(digit, 16) for digit in f"{value & 0xFFFF:04x}"))


def hex_of(value: int) -> str:
    return (value & 0xFFFF).to_bytes(2, "little").hex(" ")


@pytest.fixture(scope="module")
def ip1() -> Line:
    return Line(listening=1)


@given(value=int16)
def test_a_label_is_acknowledged_and_read_back_with_its_checksum(ip1: Line, value: int) -> None:
    ip1.run((f"59 {hex_of(value)}", f"a{checksum(value):x}"))
    ip1.run(("49", f"8{checksum(value):x} {hex_of(value)}"), ("41", "80 00 00"))


@settings(max_examples=50)
@given(value=int16, ctl=st.integers(0, 4), low_bits=st.integers(0, 7), filler=st.integers(0, 255))
def test_frame_1_takes_any_low_bits_and_filler_and_frame_2_tells_the_controller(
    ip1: Line, value: int, ctl: int, low_bits: int, filler: int
) -> None:
    ip1.run((f"{0x70 | low_bits:02x} 0d {filler:02x}", "e0"))
    ip1.run((f"{0x78 + ctl:02x} {hex_of(value)}", f"f{checksum(value):x}"))
    ip1.run((f"{0x60 | low_bits:02x} 0d {filler:02x}", "c0"))
    ip1.run((f"{0x68 + ctl:02x}", f"d{checksum(value):x} {hex_of(value)}"))


def test_every_parameter_keeps_its_own_value_on_every_motor() -> None:
    line = Line(listening=1)
    writable = [2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 13]
    for ctl in range(5):
        for parameter in writable:
            line.run((f"70 {parameter:02x} 00", "e0"))
            assert line.ask(f"{0x78 + ctl:02x} {hex_of(100 * ctl + parameter)}")[0] == "f"
    for ctl in range(5):
        for parameter in writable:
            value = 100 * ctl + parameter
            line.run((f"60 {parameter:02x} 00", "c0"))
            line.run((f"{0x68 + ctl:02x}", f"d{checksum(value):x} {hex_of(value)}"))


@pytest.mark.parametrize("reload", [False, True], ids=["power-up", "after 22"])
def test_the_defaults(reload: bool) -> None:
    line = Line(listening=1)
    if reload:
        for ctl in range(5):
            for parameter in (*DEFAULTS, 10):
                line.run((f"70 {parameter:02x} 00", "e0"), (f"{0x78 + ctl:02x} 07 00", "f7"))
        line.run(("22", "00"))
    for ctl in range(5):
        max_force = 50 if ctl == 2 else 40
        for parameter, value in {**DEFAULTS, 10: max_force}.items():
            line.run((f"60 {parameter:02x} 00", "c0"))
            line.run((f"{0x68 + ctl:02x}", f"d{checksum(value):x} {hex_of(value)}"))


def test_a_reload_ends_relative_and_force_mode_but_keeps_position_target_and_user_ram() -> None:
    line = Line(listening=1)
    line.run(("19 02 00", "00"), ("1b 02 00", "00"), ("12", "12 30 00"))
    line.label(Axis.ZED, -1000)
    line.write(Axis.ZED, 3, 440)
    line.write(Axis.ZED, 13, 4660)
    line.run(("22", "00"), ("12", "12 00 00"), ("4a", "8a 18 fc"))
    line.run(("60 03 00", "c0"), ("6a", "d2 b8 01"), ("60 0d 00", "c0"), ("6a", "d4 34 12"))


def test_modes_are_set_one_motor_at_a_time() -> None:
    line = Line(listening=1)
    line.run(("19 01 00", "00"), ("11", "11 20 00"), ("1b 01 00", "00"), ("11", "11 30 00"))
    line.run(("10", "10 00 00"), ("18 01 00", "00"), ("11", "11 10 00"), ("1a 01 00", "00"))
    line.run(("11", "11 00 00"))


@pytest.mark.parametrize("parameter", [15, 16, 0x7F, 0xFF])
def test_parameters_from_15_on_are_out_of_range(parameter: int) -> None:
    line = Line(listening=1)
    line.run((f"60 {parameter:02x} 00", "05"), ("6a", "05"))
    line.run((f"70 {parameter:02x} 00", "05"), ("7a 00 00", "05"))


def test_error_is_read_only_and_may_be_read_the_deferred_way() -> None:
    line = Line(listening=1)
    line.label(Axis.ZED, -1000)
    line.run(("70 00 00", "06"), ("7a 01 00", "05"))
    line.run(("60 00 00", "c0"), ("6a", "d0 00 00"), ("60 01 00", "c0"), ("6a", "da 18 fc"))


def test_frame_2_without_frame_1_is_refused() -> None:
    line = Line(listening=1)
    line.run(("6a", "05"), ("7a 01 00", "05"))
    line.run(("60 04 00", "c0"), ("7a 01 00", "05"), ("6a", "d2 64 00"), ("6a", "05"))
    line.run(("70 04 00", "e0"), ("6a", "05"), ("7a 1e 00", "ff"), ("7a 1e 00", "05"))


def test_traffic_with_the_other_ip_may_come_between_the_two_frames() -> None:
    line = Line(listening=1)
    line.run(("70 04 00", "e0"), ("29", "00"), ("70 0a 00", "e0"), ("29", "00"))
    line.run(("7a 1e 00", "ff"), ("29", "00"), ("7a 14 00", "f5"), ("29", "00"))
    line.run(("60 04 00", "c0"), ("6a", "df 1e 00"), ("29", "00"))
    line.run(("60 0a 00", "c0"), ("6a", "d5 14 00"))


def test_controllers_of_ip0_without_a_motor_exist_and_never_move() -> None:
    line = Line(listening=0)
    for ctl in (0, 1, 4):
        line.run((f"{0x48 + ctl:02x}", "80 00 00"), ("70 03 00", "e0"))
        line.run((f"{0x78 + ctl:02x} e8 03", "f5"))
    line.run(("b3", "00"), ("80 05 01", "00"))
    line.pass_time(0.5)
    for ctl in (0, 1, 4):
        line.run(
            (f"{0x48 + ctl:02x}", "80 00 00"), (f"{0x10 + ctl:02x}", f"{0x10 + ctl:02x} 00 00")
        )


def test_define_home_zeroes_all_counters_of_one_ip_and_moves_nothing() -> None:
    line = Line(listening=1)
    axes = [Axis.ELBOW, Axis.SHOULDER, Axis.ZED, Axis.YAW, Axis.GRIPPER]
    for axis in (*axes, Axis.WRIST1):
        line.label(axis, 777)
    line.write(Axis.ELBOW, 3, 440)
    before = [line.true(axis) for axis in axes]
    line.run(("21", "00"))
    line.pass_time(0.5)
    assert [line.true(axis) for axis in axes] == before
    assert [line.counter(axis) for axis in axes] == [0] * 5
    assert [line.error(axis) for axis in axes] == [0] * 5
    line.run(("60 03 00", "c0"), ("68", "d2 b8 01"))
    assert line.counter(Axis.WRIST1) == 777


def test_a_label_written_on_the_way_keeps_the_error_and_the_destination_in_space() -> None:
    line = Line(listening=1)
    line.model.reference()
    start = line.true(Axis.SHOULDER)
    goal = -900 if start > 0 else 900
    line.write(Axis.SHOULDER, 3, goal)
    assert line.go(Axis.SHOULDER) == "00"
    line.pass_time(0.5)
    error = line.model.axes[Axis.SHOULDER].error
    assert error != 0
    line.wire.feed(bytes.fromhex("59 00 00"), line.now_s)
    assert line.model.axes[Axis.SHOULDER].counter == 0
    assert line.model.axes[Axis.SHOULDER].error == pytest.approx(error, abs=1)
    line.pass_time(5.0)
    assert line.true(Axis.SHOULDER) == pytest.approx(goal, abs=0.1)
