"""The arm's codec beyond the reference's examples: cuts, noise, refusals, ranges.

Sections (§) are those of umi_rtx.md.
"""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import BadReplyError, PositionLostError, RefusedError, WrongDeviceError
from drivers.umi_scara.protocol import codec
from drivers.umi_scara.protocol.constants import Drive, Mode, Parameter, Simple, StatusBits

int16 = st.integers(-0x8000, 0x7FFF)
ctls = st.integers(0, 4)


def nibble_xor(value: int) -> int:
    """The checksum by the words of §2.2, written another way."""
    total = 0
    for digit in f"{value & 0xFFFF:04x}":
        total ^= int(digit, 16)
    return total


@given(value=int16)
def test_the_checksum_is_the_xor_of_the_hex_digits(value: int) -> None:
    assert codec.checksum(value) == nibble_xor(value)


@given(value=int16, cut=st.integers(0, 3))
def test_a_value_reads_the_same_wherever_the_reply_is_cut(value: int, cut: int) -> None:
    reply = bytes([0xD0 | nibble_xor(value)]) + value.to_bytes(2, "little", signed=True)
    reader = codec.ReplyReader(codec.encode_deferred_read(Parameter.SPEED, 0)[1])
    first = reader.feed(reply[:cut])
    second = reader.feed(reply[cut:]) if first is None else first
    assert second == codec.Value(value)


@given(value=int16, flip=st.integers(1, 0xFFFF))
def test_one_wrong_digit_in_a_value_never_passes(value: int, flip: int) -> None:
    digits = f"{flip:04x}"
    if sum(digit != "0" for digit in digits) != 1:
        return
    reply = bytes([0x80 | nibble_xor(value)]) + ((value & 0xFFFF) ^ flip).to_bytes(2, "little")
    reader = codec.ReplyReader(codec.encode_immediate_read(Parameter.CP_ERROR, 1))
    with pytest.raises(BadReplyError, match="checksum"):
        reader.feed(reply)


@given(value=int16, ctl=ctls)
def test_a_write_is_done_only_if_the_arm_heard_the_value_sent(value: int, ctl: int) -> None:
    frame = codec.encode_deferred_write(Parameter.NEW_POSITION, ctl, value)[1]
    good = nibble_xor(value)
    assert codec.ReplyReader(frame).feed(bytes([0xF0 | good])) == codec.Acknowledged()
    with pytest.raises(BadReplyError, match="checksum"):
        codec.ReplyReader(frame).feed(bytes([0xF0 | good ^ 1]))


@given(noise=st.binary(max_size=8), request=st.sampled_from(list(Simple)))
def test_noise_raises_only_what_the_reader_promises(noise: bytes, request: Simple) -> None:
    reader = codec.ReplyReader(codec.encode_simple(request))
    with contextlib.suppress(BadReplyError, RefusedError, PositionLostError, WrongDeviceError):
        for byte in noise:
            if reader.feed(bytes([byte])) is not None:
                break


@pytest.mark.parametrize("code", range(1, 0x0E))
def test_every_refusal_carries_its_code(code: int) -> None:
    with pytest.raises(RefusedError) as refusal:
        codec.ReplyReader(codec.encode_numeric_go([0])).feed(bytes([code]))
    assert refusal.value.code == code


@pytest.mark.parametrize("code", [0x0E, 0x0F])
@pytest.mark.parametrize("command", [Simple.IDENTIFY, Simple.TOGGLE_ONCE, Simple.GENERAL_STATUS])
def test_a_restarted_ip_means_lost_positions_whatever_was_asked(code: int, command: Simple) -> None:
    with pytest.raises(PositionLostError):
        codec.ReplyReader(codec.encode_simple(command)).feed(bytes([code]))


def test_text_is_an_unsupported_rom() -> None:
    reader = codec.ReplyReader(codec.encode_simple(Simple.IDENTIFY))
    with pytest.raises(WrongDeviceError, match="unsupported ROM or monitor mode"):
        reader.feed(b"\r\nMSP 01.00\r\n")


@pytest.mark.parametrize("first", [0x30, 0x4D, 0x50, 0x6F, 0x7E, 0x90, 0xB1])
def test_a_first_byte_the_protocol_does_not_have_is_a_bad_reply(first: int) -> None:
    with pytest.raises(BadReplyError):
        codec.ReplyReader(codec.encode_simple(Simple.IDENTIFY)).feed(bytes([first]))


@pytest.mark.parametrize(
    ("request_hex", "reply_hex"),
    [
        ("12", "11 00 00"),  # status of another controller
        ("17", "12 00 00"),
        ("01", "00"),  # an acknowledgement is no identity
        ("01", "22"),  # there is no IP2
        ("29", "21"),  # an identity is no acknowledgement
        ("42", "D0 00 00"),  # a deferred reply to an immediate read
        ("6A", "80 00 00"),
        ("60 04 00", "E0"),
        ("00", "00 00"),  # a byte too many
    ],
)
def test_a_reply_to_something_else_is_a_bad_reply(request_hex: str, reply_hex: str) -> None:
    with pytest.raises(BadReplyError):
        codec.ReplyReader(bytes.fromhex(request_hex)).feed(bytes.fromhex(reply_hex))


def test_go_is_answered_by_an_acknowledgement_or_by_an_identity() -> None:
    go = codec.encode_simple(Simple.GO)
    assert codec.ReplyReader(go).feed(b"\x00") == codec.Acknowledged()
    assert isinstance(codec.ReplyReader(go).feed(b"\x21"), codec.Identity)


@pytest.mark.parametrize("reply", [0x00, 0x0F, 0x20, 0x55])
def test_any_single_byte_answers_a_reset(reply: int) -> None:
    reset = codec.encode_simple(Simple.RESET)
    assert codec.ReplyReader(reset).feed(bytes([reply])) == codec.Acknowledged()


def test_a_status_names_its_controller_and_keeps_the_third_byte() -> None:
    reader = codec.ReplyReader(codec.encode_controller_status(2))
    status = reader.feed(bytes.fromhex("12 0A 07"))
    assert status == codec.Status(2, StatusBits.STOPPED | StatusBits.STALLED, 7)


@pytest.mark.parametrize(
    ("mode", "request_hex"),
    [
        (Mode.POSITION, "18 03 00"),
        (Mode.FORCE, "19 03 00"),
        (Mode.ABSOLUTE, "1A 03 00"),
        (Mode.RELATIVE, "1B 03 00"),
        (Mode.USER_IO_INPUT, "1C 03 00"),
        (Mode.USER_IO_OUTPUT, "1D 03 00"),
    ],
)
def test_modes_are_three_bytes(mode: Mode, request_hex: str) -> None:
    assert codec.encode_mode(mode, 3) == bytes.fromhex(request_hex)


def test_requests_have_the_lengths_of_the_framing_summary() -> None:
    three = set(range(0x18, 0x1E)) | set(range(0x58, 0x68)) | set(range(0x70, 0x80))
    three |= {0x80} | set(range(0xC0, 0x100))
    for opcode in [*range(0x80), 0x80, *range(0xA0, 0x100)]:
        assert codec.request_length(opcode) == (3 if opcode in three else 1), hex(opcode)


def test_what_the_arm_has_not_cannot_be_encoded() -> None:
    with pytest.raises(ValueError, match="ctl"):
        codec.encode_controller_status(5)
    with pytest.raises(ValueError, match="16 bits"):
        codec.encode_immediate_write(0, 40000)
    with pytest.raises(ValueError, match="read-only"):
        codec.encode_deferred_write(Parameter.CURRENT_FORCE, 0, 1)
    with pytest.raises(ValueError, match="no deferred access"):
        codec.encode_deferred_read(Parameter.CURRENT_POSITION, 0)
    with pytest.raises(ValueError, match="deferred read"):
        codec.encode_immediate_read(Parameter.SPEED, 0)
    with pytest.raises(ValueError, match="no controller"):
        codec.encode_numeric_go([])
    with pytest.raises(ValueError, match="increment"):
        codec.encode_interpolation({0: 8})
    with pytest.raises(ValueError, match="ctl"):
        codec.encode_manual_go({5: Drive.HOLD})
