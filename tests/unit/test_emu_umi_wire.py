"""The arm's line: framing, pacing, restarted state, hand-over, refusals. umi_rtx.md 1, 2.1, 7."""

import pytest
from emu_umi_line import Line
from hypothesis import given
from hypothesis import strategies as st

from emulators.umi_scara import ArmModel, ArmWire, Axis

BYTE_S = 10 / 9600  # umi_rtx.md 1.2


def test_a_restarted_ip_answers_0f_to_everything_and_keeps_the_line() -> None:
    line = Line(warm=False)
    line.run(("28", "0f"), ("01", "0f"), ("29", "0f"), ("20", "0f"), ("2a", "0f"))
    line.run(("70 04 00", "0f"), ("80 10 00", "0f"), ("bf", "0f"), ("ff", "0f"))


def test_go_brings_each_ip_up_by_itself() -> None:
    line = Line(warm=False)
    line.run(("00", "00"), ("01", "20"), ("29", "00"), ("01", "0f"), ("29", "0f"))
    line.run(("00", "00"), ("01", "21"), ("00", "21"), ("29", "00"), ("00", "20"))


def test_ip1_may_be_the_one_that_listens_at_power_up() -> None:
    Line(warm=False, listening=1).run(("00", "00"), ("01", "21"))


def test_a_toggle_hands_the_line_over_once() -> None:
    Line().run(("01", "20"), ("29", "00"), ("01", "21"), ("01", "21"), ("29", "00"), ("01", "20"))


def test_in_auto_toggle_mode_every_request_but_28_hands_the_line_over_exactly_once() -> None:
    line = Line()
    line.run(("2a", "00"), ("2a", "00"), ("01", "20"), ("01", "21"))
    line.run(("29", "00"), ("01", "21"), ("09", "00"), ("0b", "00"))  # ip 0, 1, 0, 1
    line.run(("03", "09"), ("15", "08"), ("01", "20"), ("01", "21"))  # refusals count as well
    line.run(("28", "00"), ("01", "20"), ("01", "20"), ("29", "00"), ("01", "21"), ("01", "20"))


def test_one_ip_may_be_left_in_auto_toggle_mode_by_a_predecessor() -> None:
    line = Line(warm=False)
    line.wire.run_warm(auto_toggle=True)
    line.run(("01", "20"), ("01", "21"), ("28", "00"), ("29", "00"), ("28", "00"), ("01", "21"))
    line.run(("01", "21"), ("29", "00"), ("01", "20"))


def test_a_reset_ip_is_restarted_without_power_or_auto_toggle() -> None:
    line = Line()
    line.run(("2a", "00"), ("29", "00"))
    line.run(("01", "20"), ("29", "00"))  # IP0 toggles by itself, IP1 does not
    line.run(("20", "00"), ("01", "0f"), ("00", "00"), ("01", "20"), ("01", "20"))
    line.run(("80 50 00", "00"), ("12", "12 02 00"), ("13", "13 02 00"))


def test_a_reset_restores_the_defaults_and_forgets_the_counters() -> None:
    line = Line(listening=1)
    line.write(Axis.ZED, 4, 77)
    line.write(Axis.ZED, 3, -500)
    line.label(Axis.ZED, -1234)
    line.run(("20", "00"), ("00", "00"), ("4a", "80 00 00"), ("42", "80 00 00"))
    line.run(("60 04 00", "c0"), ("6a", "d2 64 00"), ("60 03 00", "c0"), ("6a", "d0 00 00"))


UNKNOWN = [
    *range(0x02, 0x08),
    *range(0x0C, 0x10),
    *range(0x1E, 0x20),
    0x23,
    *range(0x2B, 0x38),
    *range(0x39, 0x40),
    *range(0x50, 0x58),
    *range(0x81, 0xA0),
]


@pytest.mark.parametrize("ip", [0, 1])
def test_unknown_opcodes_are_out_of_range_and_one_byte_long(ip: int) -> None:
    line = Line(listening=ip)
    for opcode in UNKNOWN:
        line.run((f"{opcode:02x}", "09"), ("01", f"2{ip}"))


@pytest.mark.parametrize("ctl", [5, 6, 7])
def test_controllers_above_4_do_not_exist(ctl: int) -> None:
    line = Line()
    for opcode in (0x10, 0x40, 0x48, 0x68):
        if opcode + ctl != 0x17:
            line.run((f"{opcode + ctl:02x}", "08"))
    line.run((f"{0x58 + ctl:02x} 01 00", "08"), ("70 04 00", "e0"))
    line.run((f"{0x78 + ctl:02x} 01 00", "08"))
    for mode in ("18", "19", "1a", "1b"):
        line.run((f"{mode} {ctl:02x} 00", "08"))
    for lines in ("1c", "1d"):  # the ctl only picks the IP
        line.run((f"{lines} {ctl:02x} 00", "00"))


def test_the_first_reply_byte_follows_1_ms_after_the_last_request_byte_then_9600_baud() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.feed(b"\x38", 5.0)
    times_s = []
    out = b""
    while (due_s := wire.next_due_s()) is not None:
        assert wire.due(due_s - 1e-5) == b""
        times_s.append(due_s)
        out += wire.due(due_s)
    assert out == bytes.fromhex("20 02 03")
    arrived_s = 5.0 + BYTE_S
    assert times_s == pytest.approx([arrived_s + 0.001 + n * BYTE_S for n in range(3)], abs=1e-9)
    assert wire.due(99.0) == b""


def test_three_bytes_and_their_answer_fit_into_8_ms() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.feed(bytes.fromhex("60 04 00"), 0.0)
    assert wire.due(0.008) == b"\xc0"
    wire.feed(b"\x6a", 0.008)
    assert len(wire.due(0.016)) == 3


def test_a_request_that_lacks_bytes_is_answered_0b_after_8_ms_and_forgotten() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.feed(bytes.fromhex("7a 18"), 0.0)
    deadline_s = BYTE_S + 0.008
    assert wire.next_due_s() == pytest.approx(deadline_s)
    assert wire.due(deadline_s - 1e-4) == b""
    assert wire.due(deadline_s) == b"\x0b"
    wire.feed(b"\x01", 0.020)
    assert wire.due(0.030) == b"\x20"


def test_a_byte_that_comes_too_late_begins_a_new_request() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.feed(bytes.fromhex("70 04"), 0.0)
    wire.feed(b"\x01", 0.012)
    assert wire.due(0.1) == bytes.fromhex("0b 20")


def test_a_request_may_come_in_pieces_within_8_ms() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    for byte, now_s in zip(bytes.fromhex("70 04 00"), (0.0, 0.003, 0.006), strict=True):
        wire.feed(bytes((byte,)), now_s)
    assert wire.due(0.1) == b"\xe0"


def test_requests_that_follow_too_closely_pass_the_tolerant_arm_but_not_the_strict_one() -> None:
    for strict, answer in ((False, "20 20 20"), (True, "20 0c 20")):
        wire = ArmWire(ArmModel(), strict=strict)
        wire.run_warm()
        wire.feed(b"\x01", 0.000)
        wire.feed(b"\x01", 0.0075)
        wire.feed(b"\x01", 0.0156)
        assert wire.due(1.0).hex(" ") == answer


def test_the_strict_arm_does_not_obey_what_it_refuses() -> None:
    wire = ArmWire(ArmModel(), strict=True)
    wire.run_warm()
    wire.feed(bytes.fromhex("01 29"), 0.0)
    wire.feed(b"\x01", 0.02)
    assert wire.due(1.0) == bytes.fromhex("20 0c 20")


def test_general_status_reports_the_io_lines_direction() -> None:
    line = Line(listening=1)
    line.run(("17", "17 00 00"), ("1c 00 00", "00"), ("17", "17 20 00"))
    line.run(("1d 00 00", "00"), ("17", "17 00 00"))


def test_general_status_reports_a_changed_line_until_it_is_read() -> None:
    line = Line(listening=0)
    line.run(("70 0e 00", "e0"), ("7a 01 00", "f1"), ("60 0e 00", "c0"), ("6b", "d1 01 00"))
    line.run(("17", "17 10 00"), ("17", "17 00 00"))
    line.run(("70 0e 00", "e0"), ("7a 01 00", "f1"), ("17", "17 00 00"))


# Requests without motion, reset or hand-over, so that any stream of them keeps IP0 listening.
HARMLESS = ["01", "00", "38", "28", "17", "12", "4a", "42", "700400", "7a1e00", "600400", "6a"]


@given(
    st.lists(st.sampled_from(HARMLESS), min_size=1, max_size=8),
    st.lists(st.integers(1, 4), min_size=1),
)
def test_replies_do_not_depend_on_how_the_request_stream_is_cut(
    requests: list[str], cuts: list[int]
) -> None:
    stream = bytes.fromhex("".join(requests))
    whole = ArmWire(ArmModel())
    cut = ArmWire(ArmModel())
    for wire in (whole, cut):
        wire.run_warm()
    whole.feed(stream, 0.0)
    at, n = 0, 0
    while at < len(stream):
        size = cuts[n % len(cuts)]
        cut.feed(stream[at : at + size], n * 0.0001)
        at += size
        n += 1
    assert whole.due(9.0) == cut.due(9.0)


@given(st.binary(max_size=40))
def test_no_bytes_break_the_wire_and_every_reply_is_one_the_manual_knows(data: bytes) -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.feed(data, 0.0)
    wire.due(1.0)
    wire.model.advance(0.05)
    wire.feed(b"\x17", 2.0)
    reply = wire.due(3.0)
    assert reply[:1] in (b"\x17", b"\x0f")
    assert len(reply) == (3 if reply[0] == 0x17 else 1)


def test_the_wire_notes_each_stop_that_a_board_has_heard() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.feed(bytes.fromhex("24"), 1.0)
    wire.feed(bytes.fromhex("29"), 1.02)  # the other board listens from here on, 2.3
    wire.feed(bytes.fromhex("25"), 1.04)
    assert [(stop.ip, stop.kind) for stop in wire.stops] == [(0, "dead"), (1, "ramp")]
    # ten bits at 9600 baud after it was handed over
    assert wire.stops[0].at_s == pytest.approx(1.0 + 10 / 9600)
