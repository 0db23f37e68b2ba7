"""What the emulated camera sees, and what the driver hands over of it."""

import asyncio

import pytest

from controller.cli.project.starter.drivers.camera import AcmeCamera
from controller.cli.project.starter.drivers.camera.emulator import AcmeDevice, serve
from drivers.clock import CellClock
from drivers.errors import ReplyTimeoutError, WrongDeviceError
from drivers.kinds import Capture

CAPTURE = Capture(
    width=64,
    height=48,
    formats=("GREY",),
    fps=20.0,
    exposure_s=0.05,
    settle_frames=0,
    margin_s=None,
    frame_late_s=0.5,
)


def _camera(address: str, clock: CellClock) -> AcmeCamera:
    host, _, port = address.rpartition(":")
    return AcmeCamera("overhead", host, int(port), CAPTURE, clock)


def test_no_light_from_before_the_instant_is_in_a_frame() -> None:
    """Switch the light while a frame is exposed: the next one after it shows the new light."""

    async def story() -> None:
        device, clock = AcmeDevice(64, 48, brightness=20), CellClock()
        async with serve(device) as address:
            camera = _camera(address, clock)
            await camera.connect()
            early = asyncio.ensure_future(camera.frame_after(clock.now_s()))
            await clock.sleep(CAPTURE.exposure_s / 2)
            device.brightness = 200
            switched_s = clock.now_s()
            assert (await early).image.max() < 200
            frame = await camera.frame_after(switched_s)
            assert frame.earliest_light_s >= switched_s
            assert frame.image.min() == frame.image.max() == 200
            await camera.close()

    asyncio.run(story())


def test_a_camera_without_a_picture_is_reported_and_works_again() -> None:
    """Let the exposure never end, then let it end again."""

    async def story() -> None:
        device, clock = AcmeDevice(64, 48, is_blind=True), CellClock()
        async with serve(device) as address:
            camera = _camera(address, clock)
            await camera.connect()
            with pytest.raises(ReplyTimeoutError):
                await camera.frame_after(clock.now_s())
            device.is_blind = False
            assert (await camera.frame_after(clock.now_s())).image.shape == (48, 64)
            await camera.close()

    asyncio.run(story())


def test_a_camera_of_another_size_is_refused() -> None:
    """Let the cell file state another size."""

    async def story() -> None:
        async with serve(AcmeDevice(640, 480)) as address:
            camera = _camera(address, CellClock())
            with pytest.raises(WrongDeviceError, match="640 480"):
                await camera.connect()
            await camera.close()

    asyncio.run(story())
