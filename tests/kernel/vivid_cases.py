"""The camera's driver on the kernel's own test camera, vivid; run by `test_camera_on_a_kernel.py`.

vivid computes its stamps: they may lie a little ahead of the instant at which a frame is given.
Its picture is a test pattern, which a control chooses.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.camera_v4l2 import Camera, CameraConfig, KernelCalls, StampSource, list_nodes
from drivers.camera_v4l2.kernel import Device
from drivers.errors import LinkError, RefusedError, UnpluggedError, WrongDeviceError

NODE = "/dev/video0"
SMALL, LARGE = (640, 360), (1280, 720)
BITS = {"GREY": 8, "YUYV": 8, "Y10": 10, "Y12": 12, "Y16": 16}
BUS = Path("/sys/bus/platform/drivers/vivid")
PATIENCE_S = 60.0  # a guard: the kernel is one processor, and slow


def config(size: tuple[int, int] = SMALL, *formats: str) -> CameraConfig:
    return CameraConfig(
        NODE,
        width=size[0],
        height=size[1],
        pixel_formats=formats or ("GREY",),
        fps=25.0,
        frame_timeout_s=PATIENCE_S,
    )


@contextmanager
def controls() -> Iterator[Device]:
    device = Device(KernelCalls(), NODE)
    try:
        yield device
    finally:
        device.close()


def choose(name: str, item: str) -> None:
    """Set one of vivid's menus by its text."""
    with controls() as device:
        (control,) = (one for one in device.list_controls() if one.name == name)
        (value,) = (number for number, text in device.menu_items(control) if text == item)
        device.set_control(control.control, value)


def plug(order: str) -> None:
    """Take vivid off its bus, or put it back: ``unbind``, ``bind``."""
    (BUS / order).write_text("vivid.0")


async def frames_of(camera: Camera, count: int) -> None:
    for _ in range(count):
        await camera.frame_after(time.monotonic())


def test_the_node_is_found_with_what_it_says_of_itself() -> None:
    (found,) = list_nodes()
    assert str(found.path) == NODE


async def test_it_names_itself() -> None:
    async with Camera(config()) as camera:
        identity = camera.identity()
        assert (identity.driver, identity.card) == ("vivid", "vivid")
        assert identity.version.startswith(os.uname().release[:3])


@pytest.mark.parametrize("size", [SMALL, LARGE])
@pytest.mark.parametrize("name", BITS)
async def test_every_format_it_offers_is_read(name: str, size: tuple[int, int]) -> None:
    choose("Test Pattern", "100% White")
    async with Camera(config(size, name)) as camera:
        white = await camera.frame_after(time.monotonic())
    choose("Test Pattern", "100% Black")
    async with Camera(config(size, name)) as camera:
        black = await camera.frame_after(time.monotonic())
    for frame in (white, black):
        assert frame.pixel_format == name
        assert frame.image.shape == (size[1], size[0])
        assert frame.image.dtype == (np.uint8 if BITS[name] == 8 else np.uint16)
        assert frame.white == (1 << BITS[name]) - 1
    # text lies over a part of the picture; limited range is 16 to 235 of 255
    assert np.median(white.image) >= 0.9 * white.white
    assert np.median(black.image) <= 0.1 * white.white


async def test_the_first_format_of_the_list_that_it_has_is_taken() -> None:
    async with Camera(config(SMALL, "MJPG", "YUYV", "GREY")) as camera:
        assert (await camera.frame_after(time.monotonic())).pixel_format == "YUYV"


async def test_a_format_that_it_has_not_is_named_with_those_it_has() -> None:
    with pytest.raises(WrongDeviceError, match=r"offers .*GREY.*wanted is one of MJPG"):
        await Camera(config(SMALL, "MJPG")).connect()


async def test_stamps_are_of_the_monotonic_clock_a_period_apart() -> None:
    async with Camera(config()) as camera:
        frames = [await camera.frame_after(time.monotonic())]
        for _ in range(5):
            frames.append(await camera.frame_after(frames[-1].timestamp_s))
            assert frames[-1].earliest_light_s >= frames[-2].timestamp_s
            # never older than the frame before, nor more than two periods ahead of now
            assert frames[-1].timestamp_s < time.monotonic() + 2 * camera.frame_period_s
        period_s = camera.frame_period_s
    assert all(b.sequence > a.sequence for a, b in pairwise(frames))
    # its own ticks are coarse, and it makes up for lost ones
    count = frames[-1].sequence - frames[0].sequence
    span_s = frames[-1].timestamp_s - frames[0].timestamp_s
    assert span_s / count == pytest.approx(period_s, rel=0.25)


@pytest.mark.parametrize(
    ("item", "source"),
    [
        ("End of Frame", StampSource.END_OF_FRAME),
        ("Start of Exposure", StampSource.START_OF_EXPOSURE),
    ],
)
async def test_what_a_stamp_marks_is_taken_from_its_flags(item: str, source: StampSource) -> None:
    choose("Timestamp Source", item)
    try:
        async with Camera(config()) as camera:
            t_s = time.monotonic()
            frame = await camera.frame_after(t_s)
    finally:
        choose("Timestamp Source", "End of Frame")
    assert frame.stamp_source is source
    assert frame.earliest_light_s >= t_s


async def test_every_control_is_listed_and_automatics_are_switched_off() -> None:
    with controls() as device:
        (automatic,) = (one for one in device.list_controls() if one.name == "Gain, Automatic")
        device.set_control(automatic.control, 1)
    async with Camera(config()) as camera:
        found = {one.name: one for one in await camera.controls()}
        settings = {one.name: one for one in camera.settings}
    assert found["Gain, Automatic"].value == 0
    assert settings["Gain, Automatic"].got == 0
    # what vivid does not have is told as such, and keeps nobody from a picture
    assert settings["auto_exposure"].got is None
    brightness = found["Brightness"]
    assert brightness.minimum < brightness.maximum
    assert brightness.value is not None
    assert "100% White" in found["Test Pattern"].menu.values()


async def test_a_second_program_is_refused_and_the_first_goes_on() -> None:
    async with Camera(config()) as camera:
        with pytest.raises(RefusedError):
            await Camera(config()).connect()
        await camera.frame_after(time.monotonic())


async def test_paused_and_resumed_it_gives_a_new_frame() -> None:
    async with Camera(config()) as camera:
        await camera.frame_after(time.monotonic())
        await camera.pause()
        t_s = time.monotonic()
        await camera.resume()
        assert (await camera.frame_after(t_s)).earliest_light_s >= t_s


async def test_unplugged_it_is_an_error_at_once_and_plugged_in_it_is_found_again() -> None:
    camera = Camera(config())
    await camera.connect()
    await camera.frame_after(time.monotonic())
    plug("unbind")
    try:
        with pytest.raises(UnpluggedError):
            await frames_of(camera, 100)  # what lies in the queue may still be taken
        with pytest.raises(LinkError):
            await camera.connect()
    finally:
        plug("bind")
    await camera.reconnect(PATIENCE_S)
    await camera.frame_after(time.monotonic())
    await camera.close()
