import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.modbus import (
    BrokenStreamError,
    MbapFrame,
    MbapReader,
    RtuFrame,
    RtuReader,
    crc16,
    encode_mbap,
    encode_rtu,
    frame_gap_s,
    request_length,
)

units = st.integers(0, 255)
pdus = st.binary(min_size=1, max_size=253)

# 0x41 to 0x48 and 0x64 to 0x6E are free for vendors: no length is known for them
vendor_pdus = st.builds(
    lambda function, data: bytes((function,)) + data,
    st.integers(0x41, 0x48),
    st.binary(min_size=1, max_size=252),
)

# One request of each function code, as the standard's chapter 6 prints its example (PDU only).
STANDARD_REQUESTS = {
    0x01: "01 0013 0013",
    0x02: "02 00C4 0016",
    0x03: "03 006B 0003",
    0x04: "04 0008 0001",
    0x05: "05 00AC FF00",
    0x06: "06 0001 0003",
    0x07: "07",
    0x08: "08 0000 A537",
    0x0B: "0B",
    0x0C: "0C",
    0x0F: "0F 0013 000A 02 CD01",
    0x10: "10 0001 0002 04 000A 0102",
    0x11: "11",
    0x16: "16 0004 00F2 0025",
    0x17: "17 0003 0006 000E 0003 06 00FF 00FF 00FF",
}


def bitwise_crc(data: bytes) -> int:
    """The standard's flow chart (serial line V1.02, 6.2.2), bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            carry = crc & 1
            crc >>= 1
            if carry:
                crc ^= 0xA001
    return crc


def test_the_crc_is_the_standards_own_example() -> None:
    # serial line V1.02, 6.2.2: frame 02 07 has CRC 1241 hex, sent 41 12
    assert crc16(b"\x02\x07") == 0x1241
    assert encode_rtu(2, b"\x07") == bytes.fromhex("02 07 41 12")


@given(st.binary(max_size=300))
def test_the_crc_table_agrees_with_the_flow_chart(data: bytes) -> None:
    assert crc16(data) == bitwise_crc(data)


@pytest.mark.parametrize("function", STANDARD_REQUESTS)
def test_a_requests_length_is_known_once_its_bytes_tell_it(function: int) -> None:
    frame = encode_rtu(17, bytes.fromhex(STANDARD_REQUESTS[function]))
    known_from = {0x0F: 7, 0x10: 7, 0x17: 11}.get(function, 2)
    for count in range(len(frame) + 1):
        expected = len(frame) if count >= known_from else None
        assert request_length(frame[:count]) == expected
    reader = RtuReader()
    for at in range(len(frame)):
        assert not reader.is_complete
        reader.feed(frame[at : at + 1])
    assert reader.is_complete
    assert reader.silence() == RtuFrame(17, frame[1:-2])


def test_the_length_of_an_unknown_function_is_unknown() -> None:
    assert request_length(bytes.fromhex("09 42 00 01 02 03 04 05")) is None


@given(units, vendor_pdus, st.lists(st.integers(0, 256), max_size=5))
def test_a_frame_is_what_stands_between_two_silences(
    unit: int, pdu: bytes, cuts: list[int]
) -> None:
    frame = encode_rtu(unit, pdu)
    reader = RtuReader()
    edges = [0, *sorted(min(cut, len(frame)) for cut in cuts), len(frame)]
    for start, end in pairwise(edges):
        reader.feed(frame[start:end])
    assert reader.silence() == RtuFrame(unit, pdu)
    assert reader.silence() is None


@given(units, vendor_pdus, st.integers(0), st.integers(1, 255))
def test_one_damaged_byte_voids_a_frame(unit: int, pdu: bytes, at: int, flip: int) -> None:
    frame = bytearray(encode_rtu(unit, pdu))
    frame[at % len(frame)] ^= flip
    reader = RtuReader()
    reader.feed(bytes(frame))
    assert reader.silence() is None


@pytest.mark.parametrize("spoilt", ["garbage before", "zeros after", "two frames in one breath"])
def test_bytes_without_a_pause_void_each_other(spoilt: str) -> None:
    frame = bytes.fromhex("09 03 07 D0 00 01 85 CF")  # modbus_devices.md 2.7
    heard = {
        "garbage before": b"\x55" + frame,
        "zeros after": frame + b"\x00",
        "two frames in one breath": frame + frame,
    }[spoilt]
    reader = RtuReader()
    reader.feed(heard)
    assert reader.silence() is None
    reader.feed(frame)
    assert reader.silence() == RtuFrame(9, bytes.fromhex("03 07D0 0001"))


def test_a_line_that_never_falls_silent_fills_no_memory() -> None:
    reader = RtuReader()
    for _ in range(1000):
        reader.feed(b"\x55" * 1000)
    assert reader.byte_count <= 257
    assert reader.silence() is None


@given(st.lists(st.tuples(st.integers(0, 0xFFFF), units, pdus), max_size=4), st.integers(1, 50))
def test_a_tcp_stream_may_be_chopped_anywhere(
    frames: list[tuple[int, int, bytes]], chop: int
) -> None:
    stream = b"".join(encode_mbap(*frame) for frame in frames)
    reader = MbapReader()
    seen = [
        frame
        for start in range(0, len(stream), chop)
        for frame in reader.feed(stream[start : start + chop])
    ]
    assert seen == [MbapFrame(*frame) for frame in frames]


@pytest.mark.parametrize(
    ("protocol", "length"), [(1, 6), (0, 0), (0, 1), (0, 255), (0x4754, 0x2048)]
)
def test_a_stream_that_is_not_modbus_ends_there(protocol: int, length: int) -> None:
    with pytest.raises(BrokenStreamError):
        MbapReader().feed(struct.pack(">HHHB", 1, protocol, length, 1))


def test_the_gap_is_three_and_a_half_characters_and_never_below_the_standards_minimum() -> None:
    assert frame_gap_s(9600) == pytest.approx(3.5 * 10 / 9600)
    assert frame_gap_s(115200) == 0.00175
