"""What strangers say on the wire against the emulated camera; §§ are those of gige_vision.md."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from emulators.camera_genicam import CameraConfig, GenicamDevice, Peer, Sensor
from emulators.camera_genicam.protocol import gvcp, gvsp
from emulators.clock import WorldClock

FRAMES = tomllib.loads((Path(__file__).parent / "gige_vision.toml").read_text())
PEER = Peer("127.0.0.1", 40000)


class NoPictures:
    def expose(self, *_: object) -> None:
        return None


def camera() -> GenicamDevice:
    return GenicamDevice(NoPictures(), WorldClock(), CameraConfig(sensor=Sensor(64, 32, 25.0)))


def raw(text: str) -> bytes:
    return bytes.fromhex(text)


@pytest.mark.parametrize("one", [pytest.param(f, id=f["name"]) for f in FRAMES["request"]])
def test_a_strangers_request_is_read(one: dict[str, Any]) -> None:
    request = gvcp.read_request(raw(one["frame"]))
    assert request is not None
    assert (request.command, request.body) == (one["command"], raw(one["body"]))
    assert request.wants_answer == (one["name"] != "resend")


def test_control_is_taken_and_told_with_the_fake_cameras_bytes() -> None:
    device = camera()
    for one in FRAMES["request"]:
        if "reply" in one:
            reply, _ = device.answer(raw(one["frame"]), PEER, 0.0)
            assert reply == raw(one["reply"]), one["name"]


def test_a_leader_has_the_fake_cameras_bytes() -> None:
    frame = raw(next(f["frame"] for f in FRAMES["stream"] if f["name"] == "leader"))
    image = gvsp.Image(0x18EC8E1A5AAD1DF0, 0x01080001, 64, 32, 0, 0)
    packets = gvsp.packets_of(0xFF79, image, bytes(64 * 32), 1400)
    assert packets[0] == frame


def test_a_trailer_has_the_fake_cameras_bytes() -> None:
    frame = raw(next(f["frame"] for f in FRAMES["stream"] if f["name"] == "trailer"))
    image = gvsp.Image(0, 0x01080001, 2048, 1, 0, 0)  # the height that the fake camera gives
    packets = gvsp.packets_of(0xFF79, image, bytes(2048), 1400)
    assert packets[-1] == frame
    assert [len(packet) + gvsp.IP_UDP_BYTES for packet in packets[1:-1]] == [1400, 720]
