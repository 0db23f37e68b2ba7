"""The GenICam driver by the real aravis over UDP; aravis' fake GigE camera is at the other end."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from genicam_wire import (
    LOOPBACK,
    NAME,
    SERIAL,
    FakeCamera,
    on_a_cable,
    on_loopback,
    why_no_cable,
    why_not_here,
)

from controller.conformance.suite import MET, Suite
from drivers.camera_genicam import Aravis, AravisError, Camera, CameraConfig, wanted_formats
from drivers.errors import DeviceError, LinkError, RefusedError, UnpluggedError, WrongDeviceError

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 640, 480

pytestmark = pytest.mark.skipif(bool(why_not_here()), reason=why_not_here())
needs_cable = pytest.mark.skipif(bool(why_no_cable()), reason=why_no_cable())


@pytest.fixture
def fake() -> Iterator[FakeCamera]:
    with on_loopback() as camera:
        yield camera


def config(**changes: Any) -> CameraConfig:
    values: dict[str, Any] = {
        "address": LOOPBACK,
        "width": WIDTH,
        "height": HEIGHT,
        "formats": wanted_formats(("GREY",)),
        "exposure_s": 0.01,
        "fps": 20.0,
        "frame_late_s": 60.0,
    }
    return CameraConfig(**{**values, **changes})


def ramp(frame: Any, top: int, step: int) -> np.ndarray:
    """Return the fake camera's picture by its source: grey rises along both sides."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return step * (x + y + frame.frame_id) % top


@pytest.mark.parametrize("address", [LOOPBACK, SERIAL, NAME])
async def test_a_camera_is_found_by_ip_serial_and_name(fake: FakeCamera, address: str) -> None:
    async with Camera(config(address=address, settle_frame_count=2)) as camera:
        assert camera.model == f"Aravis Fake {SERIAL}"
        ids = []
        for _ in range(3):
            t_s = time.monotonic()
            frame = await camera.frame_after(t_s)
            assert frame.earliest_light_s >= t_s
            ids.append(frame.frame_id)
            np.testing.assert_array_equal(frame.image, ramp(frame, 255, 1))
        assert np.diff(ids).tolist() == [1, 1]
        stats = camera.stats
        assert (stats.delivered_count, stats.settling_count) == (3, 2)
        assert stats.trigger_count - stats.incomplete_count == 5


async def test_sixteen_bits_come_through(fake: FakeCamera) -> None:
    async with Camera(config(formats=wanted_formats(("Y16", "GREY")))) as camera:
        frame = await camera.frame_after(time.monotonic())
        assert (frame.image.dtype, frame.white) == (np.uint16, 65535)
        np.testing.assert_array_equal(frame.image, ramp(frame, 65535, 256))


async def test_jumbo_packets_are_set_and_read_back(fake: FakeCamera) -> None:
    async with Camera(config(packet_size=8000)) as camera:
        assert camera.identity().packet_size == 8000
        await camera.frame_after(time.monotonic())


async def test_what_the_program_before_left_set_does_not_matter(fake: FakeCamera) -> None:
    library = Aravis.load()
    before = library.open(LOOPBACK)
    before.set_text("TriggerMode", "On")
    before.set_text("TriggerSource", "Line0")
    before.set_number("GainRaw", 9)
    before.set_number("OffsetX", 64)
    before.execute("AcquisitionStart")
    before.close()
    async with Camera(config()) as camera:
        frame = await camera.frame_after(time.monotonic())
        np.testing.assert_array_equal(frame.image, ramp(frame, 255, 1))
        was = {one.feature: one.was for one in camera.settings if one.was}
    assert was["GainRaw"] == "9"
    assert was["TriggerSource"] == "Line0"


async def test_a_camera_that_another_program_controls_is_busy(fake: FakeCamera) -> None:
    other = Aravis.load().open(LOOPBACK)
    try:
        with pytest.raises(RefusedError, match=f"camera {LOOPBACK}: busy, another program") as no:
            await Camera(config()).connect()
        assert no.value.code == 16
    finally:
        other.close()
    async with Camera(config()) as camera:
        await camera.frame_after(time.monotonic())


async def test_another_serial_number_is_the_wrong_camera(fake: FakeCamera) -> None:
    with pytest.raises(WrongDeviceError, match=f"serial number is `{SERIAL}`, `123` is expected"):
        await Camera(config(serial="123")).connect()
    with pytest.raises(WrongDeviceError, match="model is `Fake`, `Eye` is expected"):
        await Camera(config(model="Eye")).connect()
    with pytest.raises(LinkError, match=rf"no such camera answers; those that do: .*{NAME}"):
        await Camera(config(address="no-such-serial")).connect()


async def test_no_camera_at_an_address_is_a_sentence(fake: FakeCamera) -> None:
    with pytest.raises(LinkError, match=r"camera 127\.0\.0\.77: does not answer .*cable"):
        await Camera(config(address="127.0.0.77")).connect()


def test_an_error_of_the_library_has_its_words_and_its_kind(fake: FakeCamera) -> None:
    camera = Aravis.load().open(LOOPBACK)
    try:
        with pytest.raises(AravisError, match="NoSuchFeature") as no:
            camera.text("NoSuchFeature")
        assert not no.value.is_gone
        assert camera.choices("TriggerSelector") == ("FrameStart", "AcquisitionStart")
        assert camera.bounds("GainRaw") == (0.0, 10.0)
    finally:
        camera.close()


async def test_a_camera_that_restarts_is_unplugged_and_comes_back() -> None:
    with on_loopback() as fake:
        camera = Camera(config())
        await camera.connect()
        fake.stop()
        fake.start()
        # its heartbeat is read once a second: then aravis knows that it has lost control
        with pytest.raises(UnpluggedError):
            await camera.frame_after(time.monotonic(), 60.0)
        await camera.connect()
        assert (await camera.frame_after(time.monotonic())).image.shape == (HEIGHT, WIDTH)
        await camera.close()


# --- the conformance suite -----------------------------------------------------------------------


def cell_file(folder: Path, address: str, **capture: str) -> Path:
    """Write the emulated cell's file with this camera in it."""
    text = (ROOT / "recipes" / "cells" / "emulated.yaml").read_text(encoding="utf-8")
    line = f"overhead:    {{driver: genicam, address: {address}, settings: {{packet_size: 8000}}}}"
    text, count = re.subn(r"overhead: +\{address: emulated\}", line, text)
    assert count == 1
    path = folder / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def conforms(folder: Path, fake: FakeCamera) -> dict[str, str]:
    """Try every requirement; a person's hand is on the cable."""

    def obey(request: str) -> bool:
        if request.startswith("Unplug"):
            fake.unplug()
        elif request.startswith("Plug"):
            fake.plug()
        return True

    suite = Suite(
        cell_file(folder, fake.address), ["overhead"], speed=1.0, allow_motion=True, prompt=obey
    )
    suite.open()
    try:
        for requirement in suite.requirements("overhead"):
            suite.attempt("overhead", requirement)
    finally:
        suite.close()
    (tried,) = suite.findings().devices
    assert tried.model == f"Aravis Fake {SERIAL}"
    assert tried.firmware
    return {one.name: one.message for one in tried.outcomes if one.verdict != MET}


@pytest.mark.parametrize(
    "plugged",
    [
        pytest.param(on_loopback, id="loopback"),
        pytest.param(on_a_cable, id="cable", marks=needs_cable),
    ],
)
def test_the_driver_conforms(
    tmp_path: Path, plugged: Callable[..., AbstractContextManager[FakeCamera]]
) -> None:
    with plugged() as fake:
        assert conforms(tmp_path, fake) == {}


@needs_cable
def test_the_driver_conforms_where_packets_are_lost(tmp_path: Path) -> None:
    with on_a_cable("-r", "2") as fake:  # of a thousand packets two
        assert conforms(tmp_path, fake) == {}


@needs_cable
async def test_lost_packets_cost_frames_and_no_picture_is_incomplete() -> None:
    with on_a_cable("-r", "2") as fake:  # of a thousand; a frame has 210
        async with Camera(config(address=fake.address)) as camera:
            for _ in range(30):
                frame = await camera.frame_after(time.monotonic())
                np.testing.assert_array_equal(frame.image, ramp(frame, 255, 1))
            stats = camera.stats
    assert stats.delivered_count == 30
    # 34 % of frames lose a packet: none among 30 has a chance of 4e-6
    assert stats.incomplete_count > 0
    assert stats.trigger_count >= 31 + stats.incomplete_count
    assert stats.missing_packet_count >= stats.incomplete_count


@needs_cable
async def test_a_cable_that_is_pulled_in_a_wait_ends_it_and_back_it_works() -> None:
    with on_a_cable() as fake:
        camera = Camera(config(address=fake.address))
        await camera.connect()
        fake.unplug()
        with pytest.raises(DeviceError):
            await camera.frame_after(time.monotonic(), 20.0)
        fake.plug()
        deadline_s = time.monotonic() + 120.0
        while True:
            try:
                await camera.close()
                await camera.connect()
                break
            except DeviceError:
                assert time.monotonic() < deadline_s
        frame = await camera.frame_after(time.monotonic())
        np.testing.assert_array_equal(frame.image, ramp(frame, 255, 1))
        stats = dataclasses.asdict(camera.stats)
        await camera.close()
        assert stats["out_of_step_count"] == 0
