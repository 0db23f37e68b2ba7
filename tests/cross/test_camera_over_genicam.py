"""The GenICam driver, by aravis, on the emulated GigE Vision camera over UDP.

Every emulated picture shows when it was exposed, so that each frame tells by itself whether it is
one that was asked for. The cameras run in a process of their own, as in a cell.
"""

from __future__ import annotations

import asyncio
import ctypes
import sys
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "unit"))  # the helper that starts the cameras

from emu_camera_process import CameraProcess
from emu_genicam_process import genicam_cameras

from drivers.camera_genicam import Camera, CameraConfig, Frame, wanted_formats
from drivers.clock import REAL_TIME
from drivers.errors import (
    DeviceError,
    LinkError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
)
from emulators.clock_pattern import read_clock_pattern

try:
    ctypes.CDLL("libaravis-0.8.so.0")
except OSError:
    pytest.skip("libaravis-0.8 is not installed", allow_module_level=True)

# a frame of 16 bits is 70 packets, which a socket holds however late its reader is
WIDTH, HEIGHT, RATE = 320, 160, 10.0
OTHER_HOST = "192.0.2.7"
STAMP_S = 2e-6  # pictures tell microseconds
DARK_SHARE = 0.2  # of white: the brightest that noise makes of no light
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def process() -> Iterator[CameraProcess]:
    with genicam_cameras(
        "overhead", f"--width={WIDTH}", f"--height={HEIGHT}", f"--rate={RATE:g}"
    ) as running:
        yield running


@pytest.fixture
async def cameras(process: CameraProcess) -> AsyncIterator[CameraProcess]:
    """A camera as it comes from power-up, without faults."""
    process.tell(unplug="overhead")
    process.tell(plug="overhead")
    yield process
    process.tell(
        faults="overhead",
        lost_per_thousand=0, mtu_bytes=0, held_by="", is_mute=False, lost_packet_count=0,
    )  # fmt: skip


def camera(cameras: CameraProcess, **changes: Any) -> Camera:
    values: dict[str, Any] = {
        "address": cameras["overhead"],
        "width": WIDTH,
        "height": HEIGHT,
        "formats": wanted_formats(("GREY",)),
        "exposure_s": 0.01,
        "fps": RATE,
        "frame_late_s": PATIENCE_S,
    }
    return Camera(CameraConfig(**{**values, **changes}))


@dataclass
class Light:
    """The light before the camera, which goes on or off before each look.

    A frame of an earlier trigger shows the light as it was then.
    """

    cameras: CameraProcess
    is_dark: bool = False

    async def look(self, device: Camera) -> Frame:
        """Return a frame, and see that it was exposed wholly after the light had changed."""
        self.is_dark = not self.is_dark
        self.cameras.tell(faults="overhead", is_dark=self.is_dark)
        t_s = REAL_TIME.now_s()
        frame = await device.frame_after(t_s)
        assert t_s <= frame.earliest_light_s <= frame.timestamp_s
        assert frame.image.shape == (HEIGHT, WIDTH)
        assert (frame.image.max() < DARK_SHARE * frame.white) == self.is_dark
        return frame


@pytest.fixture
def light(cameras: CameraProcess) -> Light:
    return Light(cameras)


def exposure_shown_s(frame: Frame) -> float:
    """Return the length of the exposure that a picture shows [s]."""
    bits = frame.white.bit_length()
    start_s, end_s = read_clock_pattern((frame.image >> (bits - 8)).astype(np.uint8))
    return end_s - start_s


@pytest.mark.parametrize(("name", "white"), [("GREY", 255), ("Y12", 4095), ("Y16", 65535)])
async def test_frames_of_each_depth_are_exposed_after_the_instant(
    cameras: CameraProcess, light: Light, name: str, white: int
) -> None:
    async with camera(cameras, formats=wanted_formats((name,))) as device:
        for _ in range(5):
            frame = await light.look(device)
            assert frame.white == white
            if not light.is_dark:
                assert exposure_shown_s(frame) == pytest.approx(0.01, abs=STAMP_S)
        assert device.stats.out_of_step_count == 0


async def test_a_camera_as_it_comes_from_power_up_is_set_right(cameras: CameraProcess) -> None:
    async with camera(cameras, settle_frame_count=2) as device:
        was = {one.feature: one.was for one in device.settings if one.was}
        assert was["ExposureAuto"] == "Continuous"
        assert was["GainAuto"] == "Continuous"
        assert was["TriggerMode"] == "Off"
        assert float(was["Gamma"]) == pytest.approx(0.8)
        assert device.identity().exposure_s == pytest.approx(0.01)


async def test_packets_that_were_lost_are_sent_again_and_counted(
    cameras: CameraProcess, light: Light
) -> None:
    async with camera(cameras) as device:
        await light.look(device)
        cameras.tell(faults="overhead", lost_packet_count=6)
        for _ in range(4):
            await light.look(device)
        stats = device.stats
    assert stats.resent_packet_count >= 6
    assert stats.resend_request_count >= 6
    assert stats.missing_packet_count == 0


async def test_frames_that_end_half_way_are_taken_again(
    cameras: CameraProcess, light: Light
) -> None:
    async with camera(cameras) as device:
        await light.look(device)
        cameras.tell(faults="overhead", short_count=2)
        await light.look(device)
        stats = device.stats
    assert (stats.incomplete_count, stats.delivered_count) == (2, 2)


async def test_a_frame_that_is_lost_in_the_camera_is_taken_again(
    cameras: CameraProcess, light: Light
) -> None:
    async with camera(cameras) as device:
        await light.look(device)
        cameras.tell(faults="overhead", lost_count=1)
        for _ in range(3):
            await light.look(device)


async def test_a_trigger_that_the_camera_misses_is_sent_again(
    cameras: CameraProcess, light: Light
) -> None:
    async with camera(cameras) as device:
        await light.look(device)
        cameras.tell(faults="overhead", missed_trigger_count=2)
        for _ in range(3):
            await light.look(device)
        assert device.stats.unanswered_count >= 1


async def test_packets_lost_by_chance_cost_no_picture(cameras: CameraProcess, light: Light) -> None:
    async with camera(cameras) as device:
        cameras.tell(faults="overhead", lost_per_thousand=20)
        for _ in range(20):
            await light.look(device)
        stats = device.stats
    # 20 frames of 36 packets, 2 % of them lost: none at all has a chance of 5e-7
    assert stats.resend_request_count > 0
    assert stats.delivered_count == 20


async def test_a_cancelled_look_leaves_no_old_frame_behind(
    cameras: CameraProcess, light: Light
) -> None:
    async with camera(cameras, exposure_s=0.2) as device:
        for wait_s in (0.0, 0.02, 0.1, 0.18, 0.3):
            waiting = asyncio.ensure_future(device.frame_after(REAL_TIME.now_s()))
            await asyncio.sleep(wait_s)
            waiting.cancel()
            await asyncio.gather(waiting, return_exceptions=True)
            await light.look(device)


async def test_another_host_that_holds_the_camera_is_named(
    cameras: CameraProcess, light: Light
) -> None:
    cameras.tell(faults="overhead", held_by=OTHER_HOST)
    with pytest.raises(RefusedError, match=f"busy, the program at {OTHER_HOST}.* controls it"):
        await camera(cameras).connect()
    cameras.tell(faults="overhead", held_by="")
    async with camera(cameras) as device:
        await light.look(device)


async def test_a_program_here_that_died_is_outwaited(cameras: CameraProcess, light: Light) -> None:
    script = (
        "import os; from drivers.camera_genicam import Aravis; "
        f"h = Aravis.load().open({cameras['overhead']!r}); "
        "assert h.is_controller(); os.kill(os.getpid(), 9)"
    )
    died = await asyncio.create_subprocess_exec(sys.executable, "-c", script, cwd=Path.cwd())
    assert await died.wait() == -9
    async with camera(cameras) as device:
        await light.look(device)


async def test_packets_that_a_switch_does_not_pass_say_so(
    cameras: CameraProcess, light: Light
) -> None:
    cameras.tell(faults="overhead", mtu_bytes=1500)
    with pytest.raises(ReplyTimeoutError, match=r"packets of 8000 bytes .*`packet_size` to 1500"):
        await camera(cameras, packet_size=8000, frame_late_s=1.0).connect()
    async with camera(cameras) as device:
        await light.look(device)


async def test_unplugged_it_is_known_and_plugged_in_again_it_works(
    cameras: CameraProcess, light: Light
) -> None:
    device = camera(cameras)
    await device.connect()
    await light.look(device)
    cameras.tell(unplug="overhead")
    with pytest.raises(UnpluggedError, match="does not answer any more"):
        await device.frame_after(REAL_TIME.now_s())
    with pytest.raises(LinkError, match="does not answer"):
        await device.connect()
    cameras.tell(plug="overhead")
    async with asyncio.timeout(PATIENCE_S):
        while not device.is_connected:
            try:
                await device.connect()
            except DeviceError:
                await device.close()
    await light.look(device)
    await device.close()
