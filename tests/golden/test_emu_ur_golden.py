"""The page's frames against the emulated controller: each request answered with its very bytes."""

import struct
import tomllib
from pathlib import Path
from typing import Any

import pytest

from emulators.ur_arm import Message, RtdeSession, Software, UrArm
from emulators.ur_arm.wires import message_packet, realtime_packet, state_packet, version_message

SESSIONS = tomllib.loads((Path(__file__).parent / "universal_robots.toml").read_text())["session"]


@pytest.mark.parametrize("session", SESSIONS, ids=[one["name"] for one in SESSIONS])
def test_every_frame_of_a_session_is_answered_with_the_golden_bytes(
    session: dict[str, Any],
) -> None:
    arm = UrArm()
    arm.start_running()
    wire = RtdeSession(arm, Software(), set())
    for exchange in session["exchange"]:
        reply = wire.feed(bytes.fromhex(exchange["request"]))
        assert reply.hex(" ").upper() == exchange["reply"]
    if "state" in session:
        arm.cycle_count = session["state"]["cycle_count"]
        if "q_rad" in session["state"]:
            arm.place(session["state"]["q_rad"])
        assert wire.due().hex(" ").upper() == session["data"]
    if "slider" in session:
        assert arm.slider == session["slider"]


@pytest.mark.parametrize("session", SESSIONS, ids=[one["name"] for one in SESSIONS])
def test_a_session_cut_anywhere_between_its_bytes_is_answered_the_same(
    session: dict[str, Any],
) -> None:
    stream = b"".join(bytes.fromhex(one["request"]) for one in session["exchange"])
    whole = "".join(one["reply"] for one in session["exchange"]).replace(" ", "")
    wire = RtdeSession(UrArm(), Software(), set())
    replies = b"".join(wire.feed(bytes((byte,))) for byte in stream)
    assert replies == bytes.fromhex(whole)


def parts_of(packet: bytes) -> dict[int, bytes]:
    """Return the parts of a packet of state by type, each with its header."""
    size, kind = struct.unpack_from(">IB", packet)
    assert (size, kind) == (len(packet), 16)
    rest, parts = packet[5:], {}
    while rest:
        size, kind = struct.unpack_from(">IB", rest)
        parts[kind], rest = rest[:size], rest[size:]
    return parts


# sizes by the page's table 4.3
SIZES = {0: 47, 1: 251, 2: 37, 3: 75, 4: 101, 5: 225, 6: 445, 7: 61, 8: 9}
ONLY_FIRST = {5, 6}


def test_the_parts_of_the_state_have_the_sizes_of_the_page() -> None:
    parts = parts_of(state_packet(UrArm(), Software(), is_first=True))
    assert {kind: len(part) for kind, part in parts.items()} == SIZES
    parts = parts_of(state_packet(UrArm(), Software()))
    assert set(parts) == set(SIZES) - ONLY_FIRST


def test_an_older_controller_has_shorter_parts() -> None:
    parts = parts_of(state_packet(UrArm(), Software(major=3, minor=4)))
    assert [len(parts[kind]) for kind in (0, 3, 8)] == [46, 72, 7]


def test_the_mode_of_an_arm_that_runs_has_the_golden_bytes() -> None:
    arm = UrArm()
    arm.start_running()
    part = parts_of(state_packet(arm, Software()))[0]
    assert part.hex(" ").upper() == (
        "00 00 00 2F 00 "  # 47 bytes, type 0
        "00 00 00 00 00 00 00 00 "  # time stamp
        "01 01 01 00 00 00 00 "  # connected, enabled, power on
        "07 00 "  # running, position control
        "3F F0 00 00 00 00 00 00 3F F0 00 00 00 00 00 00 3F F0 00 00 00 00 00 00 00"
    )


def test_the_first_joint_has_the_golden_bytes() -> None:
    arm = UrArm()
    arm.start_running()
    arm.place((0.5, 0, 0, 0, 0, 0))
    part = parts_of(state_packet(arm, Software()))[1]
    assert part[:46].hex(" ").upper() == (
        "00 00 00 FB 01 "  # 251 bytes, type 1
        "3F E0 00 00 00 00 00 00 3F E0 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "  # 0.5, 0.5, 0
        "00 00 00 00 42 40 00 00 41 C8 00 00 41 C8 00 00 FD"  # 0 A, 48 V, 25 degrees, 253
    )


def test_messages_have_the_golden_bytes() -> None:
    arm = UrArm()
    text = message_packet(arm, Message("hi"))
    assert text.hex(" ").upper() == "00 00 00 11 14 00 00 00 00 00 00 00 00 07 00 68 69"
    refused = message_packet(arm, Message("no", line=2, column=1))
    assert refused.hex(" ").upper() == (
        "00 00 00 19 14 00 00 00 00 00 00 00 00 07 0A 00 00 00 02 00 00 00 01 6E 6F"
    )
    read_only = message_packet(arm, Message("", code=210))
    assert read_only.hex(" ").upper() == (
        "00 00 00 23 14 00 00 00 00 00 00 00 00 07 06 "
        "00 00 00 D2 00 00 00 00 00 00 00 03 00 00 00 00 00 00 00 00"
    )
    greeting = version_message(arm, Software())
    assert greeting[5:37].hex(" ").upper() == (
        "00 00 00 00 00 00 00 00 FE 03 "  # time stamp, robot interface, version
        "09 55 52 43 6F 6E 74 72 6F 6C "  # URControl
        "05 0B 00 00 00 01 00 01 A7 1E 32 30"  # 5.11.1.108318, then the date
    )


@pytest.mark.parametrize(
    ("version", "size"),
    [((3, 4), 1060), ((5, 0), 1108), ((5, 4), 1116), ((5, 9), 1140), ((5, 11), 1220)],
)
def test_the_real_time_packet_has_the_size_of_its_version(
    version: tuple[int, int], size: int
) -> None:
    arm = UrArm()
    arm.place((0.5, 0, 0, 0, 0, 0))
    packet = realtime_packet(arm, Software(major=version[0], minor=version[1]))
    assert len(packet) == size
    assert struct.unpack_from(">I", packet) == (size,)
    assert struct.unpack_from(">d", packet, 4 + 8 * 31) == (0.5,)  # gnuplot column 32: actual q
    assert struct.unpack_from(">d", packet, 4 + 8 * 94) == (3.0,)  # column 95: robot mode
    assert struct.unpack_from(">d", packet, 4 + 8 * 101) == (1.0,)  # column 102: safety mode
