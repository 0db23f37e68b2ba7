"""The camera's driver on the emulated camera: a FUSE node, or the same structs over a unix socket.

Every emulated picture shows when it was exposed, so that each frame tells by itself whether it
is one that was asked for. The cameras run in a process of their own, as in a cell.
"""

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from cross_bench import nothing_is_left, open_fds

sys.path.append(str(Path(__file__).parents[1] / "unit"))  # the helper that starts the cameras

from emu_camera_process import CameraProcess, cameras

from drivers.camera_v4l2 import Camera, CameraConfig, Frame, StampSource
from drivers.clock import CellClock
from drivers.errors import LinkError, RefusedError, ReplyTimeoutError, UnpluggedError
from emulators.camera_v4l2 import can_mount, read_clock_pattern

Transport = Literal["fuse", "socket"]
WHY_NOT = can_mount()
FUSE = pytest.param(
    "fuse", marks=pytest.mark.skipif(WHY_NOT is not None, reason=f"no FUSE: {WHY_NOT}")
)
PATIENCE_WALL_S = 60.0
SHARED_SPEED = 2.0
STAMP_S = 2e-6  # stamps and pictures tell microseconds
FPS = 20
PERIOD_S = 1 / FPS
EXPOSURE_S = 0.01


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@dataclass
class Bench:
    cameras: CameraProcess
    camera: Camera
    clock: CellClock

    def exposure_of(self, frame: Frame) -> tuple[float, float]:
        """Return start and end of the exposure that a picture shows [cell s]."""
        shift = 8 if frame.image.dtype == np.uint16 else 0
        world_s = read_clock_pattern((frame.image >> shift).astype(np.uint8))
        started_s = float(self.cameras.state["started_wall_s"])
        start_s, end_s = (
            self.clock.from_monotonic_s(started_s + s / self.clock.speed) for s in world_s
        )
        return start_s, end_s

    def is_wholly_after(self, frame: Frame, t_s: float) -> bool:
        """Tell whether a picture was exposed wholly after an instant, and its stamps are true."""
        start_s, end_s = self.exposure_of(frame)
        slack_s = STAMP_S * self.clock.speed
        assert frame.timestamp_s == pytest.approx(end_s, abs=slack_s)
        assert frame.earliest_light_s <= start_s + slack_s
        return start_s >= t_s - slack_s


def config_of(address: str, **changes: Any) -> CameraConfig:
    return CameraConfig(
        address,
        **{
            "width": 640,
            "height": 512,
            "fps": FPS,
            "exposure_s": EXPOSURE_S,
            "pixel_formats": ("GREY",),
            **changes,
        },
    )


@contextmanager
def camera_process(
    folder: Path, transport: Transport, speed: float, *options: str
) -> Iterator[CameraProcess]:
    with cameras(
        folder / "dev", f"--transport={transport}", f"--rate={FPS}", f"--speed={speed}", *options
    ) as process:
        assert process.state["transport"] == transport
        yield process


@asynccontextmanager
async def camera_bench(
    folder: Path,
    transport: Transport,
    *options: str,
    speed: float = 1.0,
    **changes: Any,
) -> AsyncIterator[Bench]:
    with camera_process(folder, transport, speed, *options) as process:
        clock = CellClock(speed, PATIENCE_WALL_S)
        camera = Camera(config_of(process["video0"], **changes), clock)
        try:
            await camera.connect()
            yield Bench(process, camera, clock)
        finally:
            await camera.close()


@pytest.fixture(scope="module")
def processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, CameraProcess]]:
    """Start one process for each way there is: it costs half a second, and most tests share it."""
    with ExitStack() as stack:
        paths: list[Transport] = ["socket"] if WHY_NOT else ["socket", "fuse"]
        yield {
            way: stack.enter_context(
                camera_process(tmp_path_factory.mktemp(way), way, SHARED_SPEED)
            )
            for way in paths
        }


@asynccontextmanager
async def shared_bench(
    processes: dict[str, CameraProcess], transport: str, **changes: Any
) -> AsyncIterator[Bench]:
    process = processes[transport]
    clock = CellClock(SHARED_SPEED, PATIENCE_WALL_S)
    camera = Camera(config_of(process["video0"], **changes), clock)
    try:
        await camera.connect()
        yield Bench(process, camera, clock)
    finally:
        await camera.close()
        process.tell(faults="video0")  # none


@pytest.fixture(params=[FUSE, "socket"])
async def bench(
    request: pytest.FixtureRequest, processes: dict[str, CameraProcess]
) -> AsyncIterator[Bench]:
    async with shared_bench(processes, request.param) as bench:
        yield bench


# ---- pictures ------------------------------------------------------------------------------------
@pytest.mark.parametrize("transport", [FUSE, "socket"])
async def test_every_format_comes_through_whole_at_full_size(
    processes: dict[str, CameraProcess], transport: Transport
) -> None:
    for name in ("GREY", "YUYV", "MJPG", "Y16"):
        async with shared_bench(
            processes, transport, pixel_formats=(name,), width=1280, height=1024
        ) as bench:
            t_s = bench.clock.now_s()
            frame = await bench.camera.frame_after(t_s)
            assert frame.pixel_format.strip() == name
            assert frame.image.shape == (1024, 1280) == bench.camera.shape
            assert frame.white == (65535 if name == "Y16" else 255)
            assert frame.exposure_s == pytest.approx(EXPOSURE_S)
            assert bench.is_wholly_after(frame, t_s)
            # the pattern's grey: 128 at 15.7 ms, in proportion to the exposure
            grey = float(frame.image[600:].mean()) / frame.white * 255
            assert grey == pytest.approx(128 * EXPOSURE_S / 0.0157, abs=1.5)


async def test_a_size_and_rate_that_the_camera_lacks_are_answered_with_its_own(
    processes: dict[str, CameraProcess],
) -> None:
    async with shared_bench(processes, "socket", width=700, height=500, fps=27) as bench:
        assert bench.camera.shape == (512, 640)
        assert bench.camera.frame_period_s == pytest.approx(1 / 30)
        assert (await bench.camera.frame_after(bench.clock.now_s())).image.shape == (512, 640)


# ---- frames after an instant ---------------------------------------------------------------------
@pytest.mark.parametrize(
    ("transport", "speed"),
    [
        pytest.param("fuse", 1.0, marks=FUSE.marks),
        pytest.param("fuse", 10.0, marks=FUSE.marks),
        ("socket", 10.0),
        pytest.param("socket", 1.0, marks=pytest.mark.slow),
    ],
)
async def test_a_frame_after_an_instant_was_exposed_wholly_after_it(
    tmp_path: Path, transport: Transport, speed: float
) -> None:
    """Also after a pause, when the queue is full of old pictures, and for instants to come."""
    async with camera_bench(tmp_path, transport, speed=speed) as bench:
        rng = np.random.default_rng(7)
        for offset_s in (0.0, -0.3, 0.2, *rng.uniform(0.0, 2 * PERIOD_S, 3)):
            t_s = bench.clock.now_s() + offset_s
            frame = await bench.camera.frame_after(t_s)
            assert bench.is_wholly_after(frame, t_s)
            await bench.clock.sleep(PERIOD_S * 7 * rng.random())  # the ring of 4 runs full
        assert bench.camera.stats.stale_count > 0


@pytest.mark.parametrize("margin_s", [None, 0.0])
async def test_a_light_that_changes_is_seen_within_so_many_frames(
    processes: dict[str, CameraProcess], margin_s: float | None
) -> None:
    """From the change to the frame in hand, in frame periods: 1 to begin, exposure, the margin."""
    async with shared_bench(processes, "socket", frame_margin_s=margin_s) as bench:
        delays = []
        for step in range(8):
            await bench.clock.sleep(PERIOD_S * (1 + step / 8))
            changed_s = bench.clock.now_s()
            frame = await bench.camera.frame_after(changed_s)
            assert bench.is_wholly_after(frame, changed_s)
            delays.append((frame.timestamp_s - changed_s) / PERIOD_S)
        margin_periods = 1.0 if margin_s is None else 0.0  # an end stamp's default is one period
        exposed_periods = EXPOSURE_S / PERIOD_S
        # a frame begins within one period of any instant; a busy host loses some, never all
        assert min(delays) >= exposed_periods + margin_periods - 1e-3
        assert min(delays) <= exposed_periods + margin_periods + 1.0 + 1e-3


async def test_stamps_of_the_first_packet_are_not_taken_for_the_exposures(tmp_path: Path) -> None:
    async with camera_bench(tmp_path, "socket", "--soe") as bench:
        t_s = bench.clock.now_s()
        frame = await bench.camera.frame_after(t_s)
        assert frame.stamp_source is StampSource.FIRST_PACKET
        start_s, _ = bench.exposure_of(frame)
        assert start_s >= t_s


async def test_a_frame_is_of_the_exposure_that_was_set_before_it(bench: Bench) -> None:
    for exposure_s in (0.004, 0.02):
        taken_s = await bench.camera.set_exposure(exposure_s)
        assert taken_s == pytest.approx(exposure_s)
        frame = await bench.camera.frame_after(bench.clock.now_s())
        start_s, end_s = bench.exposure_of(frame)
        assert end_s - start_s == pytest.approx(exposure_s, abs=2 * STAMP_S)
        assert frame.exposure_s == pytest.approx(exposure_s)


async def test_a_control_that_takes_effect_late_is_waited_for(
    processes: dict[str, CameraProcess],
) -> None:
    async with shared_bench(processes, "socket", settle_frame_count=5) as bench:
        bench.cameras.tell(faults="video0", control_delay_frames=3)
        await bench.camera.set_exposure(0.004)
        frame = await bench.camera.frame_after(bench.clock.now_s())
        start_s, end_s = bench.exposure_of(frame)
        assert end_s - start_s == pytest.approx(0.004, abs=2 * STAMP_S)


PAUSE_COUNT = 30  # exposures


async def test_paused_frames_come_anew_after_resuming(bench: Bench) -> None:
    await bench.camera.frame_after(bench.clock.now_s())
    await bench.camera.pause()
    await bench.clock.sleep(PAUSE_COUNT * PERIOD_S)
    resumed_s = bench.clock.now_s()
    await bench.camera.resume()
    frame = await bench.camera.frame_after(resumed_s)
    assert bench.is_wholly_after(frame, resumed_s)
    # a busy machine may lose some while the stream runs; those of the pause are not lost
    assert bench.camera.stats.lost_count < PAUSE_COUNT / 2


# ---- faults --------------------------------------------------------------------------------------
BAD_FRAMES = {  # fault: the tally that counts it
    "error_count": "error_count",
    "short_count": "short_count",
    "lost_count": "lost_count",
    "broken_jpeg_count": "broken_count",
}


@pytest.mark.parametrize("fault", BAD_FRAMES)
async def test_bad_frames_are_passed_over_and_counted(
    processes: dict[str, CameraProcess], fault: str
) -> None:
    formats = ("MJPG",) if fault == "broken_jpeg_count" else ("GREY",)
    async with shared_bench(processes, "socket", pixel_formats=formats) as bench:
        await bench.camera.frame_after(bench.clock.now_s())
        # a ring that is drained, and watched: a gap in the numbers is a loss and no idle gap
        waiting = asyncio.create_task(bench.camera.frame_after(bench.clock.now_s() + 8 * PERIOD_S))
        bench.cameras.tell(faults="video0", **{fault: 12})
        t_s = bench.clock.now_s()
        await waiting
        frame = await bench.camera.frame_after(t_s + 10 * PERIOD_S)
        assert bench.is_wholly_after(frame, t_s)
        assert getattr(bench.camera.stats, BAD_FRAMES[fault]) > 0


async def test_a_clock_that_is_not_ours_is_told_and_the_rule_still_holds(
    processes: dict[str, CameraProcess],
) -> None:
    async with shared_bench(processes, "socket") as bench:
        bench.cameras.tell(faults="video0", timestamp_unknown=True)
        await bench.camera.frame_after(bench.clock.now_s())
        for _ in range(3):
            t_s = bench.clock.now_s()
            frame = await bench.camera.frame_after(t_s)
            assert frame.stamp_source is StampSource.DEQUEUED
            assert bench.exposure_of(frame)[0] >= t_s - STAMP_S


async def test_a_stalled_camera_is_a_time_out_and_then_goes_on(bench: Bench) -> None:
    bench.cameras.tell(faults="video0", is_stalled=True)
    await asyncio.sleep(0)
    bench.camera._clock = CellClock(SHARED_SPEED)  # the time-out is what is tested
    with pytest.raises(ReplyTimeoutError, match="no frame exposed after"):
        await bench.camera.frame_after(bench.clock.now_s() + 2 * PERIOD_S, timeout_s=0.6)
    bench.camera._clock = bench.clock
    bench.cameras.tell(faults="video0")
    t_s = bench.clock.now_s()
    assert bench.is_wholly_after(await bench.camera.frame_after(t_s), t_s)


# ---- the cable -----------------------------------------------------------------------------------
async def test_an_unplug_ends_the_wait_and_a_replug_is_found_with_its_settings(
    bench: Bench,
) -> None:
    bench.cameras.tell(faults="video0", is_stalled=True)
    looks = bench.camera.frame_after(bench.clock.now_s() + 2 * PERIOD_S, timeout_s=100.0)
    waiting = asyncio.create_task(looks)
    await bench.clock.sleep(4 * PERIOD_S)
    bench.cameras.tell(unplug="video0")
    with pytest.raises(UnpluggedError):
        await asyncio.wait_for(waiting, 600)
    bench.cameras.tell(faults="video0")
    assert not bench.camera.is_connected
    with pytest.raises(LinkError):
        await bench.camera.connect()
    reconnecting = asyncio.create_task(bench.camera.reconnect(timeout_s=20.0))
    await asyncio.sleep(0.05)
    bench.cameras.tell(plug="video0")
    await reconnecting
    assert bench.camera.exposure_s == pytest.approx(EXPOSURE_S)  # the camera itself forgot it
    t_s = bench.clock.now_s()
    frame = await bench.camera.frame_after(t_s)
    assert bench.is_wholly_after(frame, t_s)
    start_s, end_s = bench.exposure_of(frame)
    assert end_s - start_s == pytest.approx(EXPOSURE_S, abs=2 * STAMP_S)


async def frames_for_ever(bench: Bench) -> None:
    while True:
        await bench.camera.frame_after(bench.clock.now_s())


@pytest.mark.parametrize("transport", [FUSE, "socket"])
async def test_a_camera_whose_server_dies_is_unplugged(
    tmp_path: Path, transport: Transport
) -> None:
    async with camera_bench(tmp_path, transport) as bench:
        await bench.camera.frame_after(bench.clock.now_s())
        waiting = asyncio.create_task(frames_for_ever(bench))
        bench.cameras.is_killed = True
        os.kill(bench.cameras.pid, 9)
        with pytest.raises(UnpluggedError):
            await asyncio.wait_for(waiting, 600)


async def test_a_camera_that_another_program_has_is_refused(bench: Bench) -> None:
    other = Camera(config_of(bench.cameras["video0"]), bench.clock)
    with pytest.raises(RefusedError):
        await other.connect()
    await bench.camera.frame_after(bench.clock.now_s())
