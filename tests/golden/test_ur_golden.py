"""The UR driver's codec against frames worked from the guide's tables (ur.md 2), cut anywhere."""

from __future__ import annotations

import re
import struct
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import BadReplyError
from drivers.ur_arm.protocol import (
    MessageReader,
    Package,
    PackageReader,
    PackageType,
    decode_accepted,
    decode_recipe,
    decode_text,
    decode_version,
    encode_outputs,
    encode_request,
    encode_version,
    movej,
    set_payload,
    set_tcp,
    stopj,
)

HERE = Path(__file__).parent
GOLDEN: dict[str, Any] = tomllib.loads((HERE / "ur.toml").read_text(encoding="utf-8"))
PAGE = (HERE.parents[1] / "docs" / "protocols" / "ur.md").read_text(encoding="utf-8")


def frame(section: str, key: str = "reply") -> bytes:
    return bytes.fromhex(GOLDEN[section][key])


def package(section: str, key: str = "reply") -> Package:
    (one,) = PackageReader().feed(frame(section, key))
    return one


def test_every_frame_stands_on_the_page() -> None:
    printed = set(re.findall(r"`([0-9A-F]{2}(?: [0-9A-F]{2})*)`", PAGE))
    frames = {
        value
        for section in GOLDEN.values()
        for key, value in section.items()
        if key.startswith(("request", "reply"))
    }
    assert len(frames) == 10
    assert frames <= printed


def test_requests_are_the_guides() -> None:
    assert encode_version() == frame("version", "request")
    assert encode_request(PackageType.CONTROLLER) == frame("controller", "request")
    outputs = GOLDEN["outputs"]
    assert encode_outputs(outputs["frequency_hz"], outputs["names"]) == frame("outputs", "request")
    assert encode_request(PackageType.START) == frame("start", "request")


def test_replies_are_read() -> None:
    assert decode_accepted(package("version").payload)
    assert decode_version(package("controller").payload) == tuple(GOLDEN["controller"]["version"])
    recipe = decode_recipe(package("outputs").payload, GOLDEN["outputs"]["names"])
    assert (recipe.number, recipe.missing) == (1, ())
    assert recipe.unpack(package("data").payload) == GOLDEN["data"]["values"]
    lacking = decode_recipe(
        package("outputs", "reply_not_found").payload, GOLDEN["outputs"]["names"]
    )
    assert lacking.missing == ("robot_mode",)
    assert decode_text(package("text").payload) == GOLDEN["text"]["words"]


def test_the_frames_of_the_other_reading_are_the_same() -> None:
    other = tomllib.loads((HERE / "universal_robots.toml").read_text(encoding="utf-8"))
    sessions = {one["name"]: one for one in other["session"]}
    joints = sessions["joints at 125 Hz"]
    version, outputs, start = joints["exchange"]
    assert encode_version() == bytes.fromhex(version["request"])
    names = ("timestamp", "actual_q")
    assert encode_outputs(125.0, names) == bytes.fromhex(outputs["request"])
    assert encode_request(PackageType.START) == bytes.fromhex(start["request"])
    (reply,) = PackageReader().feed(bytes.fromhex(outputs["reply"]))
    (data,) = PackageReader().feed(bytes.fromhex(joints["data"]))
    assert decode_recipe(reply.payload, names).unpack(data.payload) == {
        "timestamp": 1.0,
        "actual_q": tuple(joints["state"]["q_rad"]),
    }
    modes = ("robot_mode", "safety_mode", "runtime_state", "speed_scaling")
    running = sessions["modes of an arm that runs"]
    assert encode_outputs(500.0, modes) == bytes.fromhex(running["exchange"][1]["request"])
    (reply,) = PackageReader().feed(bytes.fromhex(running["exchange"][1]["reply"]))
    (data,) = PackageReader().feed(bytes.fromhex(running["data"]))
    assert decode_recipe(reply.payload, modes).unpack(data.payload) == dict(
        zip(modes, (7, 1, 1, 1.0), strict=True)
    )


@given(cuts=st.lists(st.integers(0, 62), max_size=6))
def test_packages_are_found_wherever_the_stream_is_cut(cuts: list[int]) -> None:
    stream = frame("version") + frame("controller") + frame("data") + frame("text") + b"\x00"
    reader, found = PackageReader(), list[Package]()
    ends = [0, *sorted(cuts), len(stream)]
    for begin, end in pairwise(ends):
        found += reader.feed(stream[begin:end])
    assert found == [package(one) for one in ("version", "controller", "data", "text")]


@pytest.mark.parametrize(
    "data", [b"\x00\x02V", b"\x00\x05Q\x00\x00", b"SSH-2.0", b"HTTP/1.1 400"], ids=repr
)
def test_what_is_not_rtde_is_named_and_never_guessed(data: bytes) -> None:
    with pytest.raises(BadReplyError, match="not RTDE"):
        PackageReader().feed(data)


def test_data_of_another_recipe_or_length_is_no_state() -> None:
    recipe = decode_recipe(package("outputs").payload, GOLDEN["outputs"]["names"])
    payload = package("data").payload
    for wrong in (b"", payload[:-1], payload + b"\x00", b"\x02" + payload[1:]):
        with pytest.raises(BadReplyError, match="RTDE data of"):
            recipe.unpack(wrong)
    for wrong in (b"", b"\x01DOUBLE", b"\x01DOUBLE,FLOAT"):
        with pytest.raises(BadReplyError, match="types of 2 fields"):
            decode_recipe(wrong, GOLDEN["outputs"]["names"])


# ---- messages and lines -----------------------------------------------------------------------
def message(kind: int, body: bytes) -> bytes:
    """Return a message of the primary port (ur.md 4.3)."""
    inside = struct.pack(">Qbb", 12345, 7, kind) + body
    return struct.pack(">IB", 5 + len(inside), 20) + inside


STATE = struct.pack(">IB", 5 + 40, 16) + bytes(40)
MESSAGES = [
    (message(0, b"hello"), "hello"),
    (message(6, struct.pack(">iiiII", 210, 0, 3, 0, 0) + b"local"), "C210A0: local"),
    (message(7, struct.pack(">iiB", 1, 2, 5) + b"title" + b"key text"), "key text"),
    (message(10, struct.pack(">ii", 3, 14) + b"unknown name"), "line 3, column 14: unknown name"),
]


@given(cut=st.integers(0, 200))
def test_messages_are_found_between_states_wherever_the_stream_is_cut(cut: int) -> None:
    stream = b"".join(STATE + one + message(3, b"version") for one, _ in MESSAGES)
    reader = MessageReader()
    found = reader.feed(stream[:cut]) + reader.feed(stream[cut:])
    assert found == [text for _, text in MESSAGES]


def test_a_stream_that_is_none_of_messages_is_dropped() -> None:
    reader = MessageReader()
    assert reader.feed(b"\xff" * 5000) == []
    assert reader.feed(MESSAGES[0][0]) == ["hello"]
    assert reader.feed(message(6, b"short")) == []


def test_lines_are_urscript() -> None:
    q = [0.1, -1.5, 1.25, 0.0, -1.570796327, 3.0]
    assert movej(q, 1.4, 1.05) == (
        b"movej([0.100000000, -1.500000000, 1.250000000, 0.000000000, -1.570796327, 3.000000000], "
        b"a=1.400000, v=1.050000)\n"
    )
    assert stopj(20.0) == b"stopj(20.000000)\n"
    assert set_payload(0.925, (0.0, 0.0, 58.0)) == (
        b"set_payload(0.925000, [0.000000, 0.000000, 0.058000])\n"
    )
    assert set_tcp(177.0) == b"set_tcp(p[0.0, 0.0, 0.177000, 0.0, 0.0, 0.0])\n"
