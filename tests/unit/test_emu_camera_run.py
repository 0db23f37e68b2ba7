"""The running emulated camera: its loop on the world's clock, and how it ends when broken."""

import asyncio
import contextlib
import fcntl
import os
from collections.abc import AsyncIterator, Hashable
from pathlib import Path

import numpy as np
import pytest
from emu_camera_bench import Memory
from emu_camera_client import EXPOSURE, EXPOSURE_AUTO, QUERYCAP, Client
from emu_camera_process import is_mounted

from emulators.camera_v4l2 import (
    CameraConfig,
    CameraServer,
    ClockPattern,
    Faults,
    FuseMount,
    V4l2Device,
    can_mount,
    read_clock_pattern,
)
from emulators.clock import WorldClock

SPEED = 10.0
SIZE_PX = (160, 128)
WHY_NOT = can_mount()
needs_fuse = pytest.mark.skipif(WHY_NOT is not None, reason=f"no FUSE: {WHY_NOT}")


class CountingClock:
    """World time ten times as fast, and how often it was asked for."""

    def __init__(self) -> None:
        self._clock = WorldClock(speed=SPEED)
        self.asked_count = 0

    def now_s(self) -> float:
        self.asked_count += 1
        return self._clock.now_s()

    def to_monotonic_s(self, world_s: float) -> float:
        return self._clock.to_monotonic_s(world_s)


class Alive:
    """A running camera whose frames are awaited."""

    def __init__(self, delay_wall_s: float = 0.0) -> None:
        self.clock = CountingClock()
        self.pattern = ClockPattern(SIZE_PX, delay_wall_s)
        self.device = V4l2Device(self.pattern, self.clock, CameraConfig(sizes_px=(SIZE_PX,)))
        self.pattern.connect(self.device.deliver)
        self.memory = Memory()
        self.frames: asyncio.Queue[int] = asyncio.Queue()
        self.device.attach(self)
        number = self.device.open()
        self.client = Client(lambda request, data: self.device.ioctl(number, request, data))

    def store(self, offset_bytes: int, frame: bytes) -> None:
        self.memory.store(offset_bytes, frame)

    def wake(self, frame_of: int | None) -> None:
        if frame_of is not None:
            self.frames.put_nowait(frame_of)


@pytest.fixture
async def alive() -> AsyncIterator[Alive]:
    camera = Alive()
    running = asyncio.create_task(camera.device.run())
    yield camera
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running


async def test_frames_come_at_world_rate_with_the_stamp_of_their_exposure(alive: Alive) -> None:
    alive.client.set(EXPOSURE_AUTO, 1)
    alive.client.set(EXPOSURE, 100)
    alive.client.start(3)
    found = []
    for _ in range(12):
        async with asyncio.timeout(600):
            await alive.frames.get()
        frame = alive.client.dequeue()
        grey = np.frombuffer(alive.memory.slots[frame.offset_bytes], np.uint8)
        alive.client.queue(frame.index)
        start_s, end_s = read_clock_pattern(grey.reshape(SIZE_PX[1], SIZE_PX[0]))
        assert end_s - start_s == pytest.approx(0.01, abs=2e-6)
        assert frame.stamp_us == pytest.approx(alive.clock.to_monotonic_s(end_s) * 1e6, abs=2)
        found.append((frame.sequence, end_s))
    (first, first_s), (last, last_s) = found[0], found[-1]
    assert last_s - first_s == pytest.approx((last - first) / 10, abs=1e-5)  # 10 Hz of the world
    assert last - first >= 11


async def test_a_camera_that_nothing_is_queued_to_costs_nothing(alive: Alive) -> None:
    alive.client.start(1)
    async with asyncio.timeout(600):
        await alive.frames.get()
    await asyncio.sleep(0)  # the loop falls asleep
    before = alive.clock.asked_count
    await asyncio.sleep(0.3)  # thirty frame periods, which pass because nothing happens
    assert alive.clock.asked_count == before
    alive.client.queue(alive.client.dequeue().index)  # wakes it
    async with asyncio.timeout(600):
        await alive.frames.get()
    assert alive.client.dequeue().sequence >= 30


async def test_a_stall_taken_back_wakes_the_camera(alive: Alive) -> None:
    alive.device.faults = Faults(is_stalled=True)
    alive.client.start(2)
    await asyncio.sleep(0.05)
    assert alive.frames.empty()
    alive.device.faults = Faults()
    async with asyncio.timeout(600):
        await alive.frames.get()


async def test_slow_pictures_lose_frames_and_hold_nothing_up() -> None:
    camera = Alive(delay_wall_s=0.05)  # five frame periods at this speed, two in flight
    running = asyncio.create_task(camera.device.run())
    camera.client.start(4)
    numbers = []
    for _ in range(6):
        async with asyncio.timeout(600):
            await camera.frames.get()
        frame = camera.client.dequeue()
        camera.client.queue(frame.index)
        numbers.append(frame.sequence)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert numbers == sorted(set(numbers))
    assert numbers[-1] - numbers[0] > 8  # of ten in a tenth of a second, four are made at most


class Broken(ClockPattern):
    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float
    ) -> Hashable | None:
        raise ZeroDivisionError("the renderer is broken")


async def test_a_broken_picture_source_ends_the_run_with_its_error(tmp_path: Path) -> None:
    device = V4l2Device(Broken(SIZE_PX), WorldClock(SPEED), CameraConfig(sizes_px=(SIZE_PX,)))
    number = device.open()
    client = Client(lambda request, data: device.ioctl(number, request, data))
    async with CameraServer({"video0": device}, tmp_path, "socket") as server:
        client.start(1)
        with pytest.raises(ExceptionGroup) as caught:
            async with asyncio.timeout(600):
                await server.run()
    assert caught.group_contains(ZeroDivisionError)


@needs_fuse
async def test_a_mount_whose_server_fails_is_given_up_and_hangs_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("the server is broken")

    directory = tmp_path / "dev"
    device = V4l2Device(ClockPattern(SIZE_PX), WorldClock(), CameraConfig(sizes_px=(SIZE_PX,)))
    async with CameraServer({"video0": device}, directory, "fuse") as server:
        fd = os.open(server.addresses["video0"], os.O_RDWR)
        monkeypatch.setattr(FuseMount, "_ioctl", fail)
        running = asyncio.create_task(server.run())
        # into a bytearray, so that the interpreter's lock is free for the server's threads
        with pytest.raises(OSError, match=r"abort|not connected"):
            await asyncio.to_thread(fcntl.ioctl, fd, QUERYCAP, bytearray(104))
        with pytest.raises(ExceptionGroup) as caught:
            async with asyncio.timeout(600):
                await running
        assert caught.group_contains(ConnectionAbortedError)
        with contextlib.suppress(OSError):
            os.close(fd)
        assert not is_mounted(directory)
    assert "is given up" in caplog.text


@needs_fuse
async def test_a_closed_server_leaves_no_mount_thread_or_file(tmp_path: Path) -> None:
    device = V4l2Device(ClockPattern(SIZE_PX), WorldClock(), CameraConfig(sizes_px=(SIZE_PX,)))
    directory = tmp_path / "dev"

    def left() -> set[str]:
        return {
            target
            for fd in os.listdir("/proc/self/fd")  # noqa: PTH208 - names
            if os.path.lexists(f"/proc/self/fd/{fd}")
            and "fuse" in (target := os.readlink(f"/proc/self/fd/{fd}"))  # noqa: PTH115 - a name
        }

    async with CameraServer({"video0": device}, directory, "fuse"):
        assert is_mounted(directory)
        assert left() == {"/dev/fuse"}
    assert not is_mounted(directory)
    assert left() == set()
