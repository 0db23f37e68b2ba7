"""The camera against a scripted one: the frame handed over, what is counted, what is raised."""

import asyncio
import errno
import threading
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_fakes import (
    ERROR,
    MONOTONIC,
    START_OF_EXPOSURE,
    FakeCalls,
    FakeCamera,
    until,
)

from drivers.camera_v4l2 import Camera, CameraConfig, Frame, StampSource
from drivers.clock import REAL_TIME, CellClock
from drivers.errors import (
    BadReplyError,
    FaultError,
    LinkError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
    WrongDeviceError,
)

WIDTH, HEIGHT = 8, 4
SIZE = WIDTH * HEIGHT
EXPOSURE_S, MARGIN_S, PERIOD_S = 0.010, 0.005, 0.1
ENOUGH_S = EXPOSURE_S + MARGIN_S  # an end stamp this much after t is just good enough


def picture(level: int) -> bytes:
    return bytes([level]) * SIZE


@pytest.fixture
def fake() -> FakeCamera:
    """A camera that is set already, so that connecting changes nothing and costs no frame."""
    camera = FakeCamera(WIDTH, HEIGHT)
    for control, value in ((0x0098090C, 0), (0x009A0901, 1), (0x009A0902, 100)):
        camera.controls[control].value = value
    return camera


@pytest.fixture
def calls(fake: FakeCamera) -> FakeCalls:
    return FakeCalls(fake)


def config(**changes: object) -> CameraConfig:
    values: dict[str, object] = {
        "device": "/dev/video0",
        "width": WIDTH,
        "height": HEIGHT,
        "fps": 1 / PERIOD_S,
        "exposure_s": EXPOSURE_S,
        "frame_margin_s": MARGIN_S,
        "settle_frame_count": 0,
    }
    return CameraConfig(**{**values, **changes})  # type: ignore[arg-type]  # a test's shorthand


Connect = Callable[..., "asyncio.Future[Camera]"]


@pytest.fixture
async def connect(calls: FakeCalls) -> AsyncIterator[Connect]:
    """Connect cameras, and see that nothing of them is left behind."""
    threads, cameras = set(threading.enumerate()), []

    async def connected(clock: CellClock = REAL_TIME, **changes: object) -> Camera:
        camera = Camera(config(**changes), clock, calls)
        cameras.append(camera)
        await camera.connect()
        return camera

    yield connected  # type: ignore[misc]  # a coroutine function is as good as one of futures
    for camera in cameras:
        await camera.close()
    assert calls.is_all_released
    assert {t for t in threading.enumerate() if t.name.startswith("camera")} <= threads


def past_s() -> float:
    """An instant a while ago, so that stamps shortly after it are not in the future."""
    return time.monotonic() - 1.0


async def waiting(fake: FakeCamera, camera: Camera, *args: float) -> asyncio.Task[Frame]:
    """Start a wait for a frame and return once the queue was seen empty."""
    before = fake.seen["DQBUF"]
    task = asyncio.create_task(camera.frame_after(*args))
    await until(lambda: fake.seen["DQBUF"] > before or task.done())
    return task


# -- the frame that is handed over ----------------------------------------------------------------


async def test_the_first_frame_exposed_wholly_after_the_instant_is_handed_over(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    fake.finish(picture(1), t_s - 0.5)
    fake.finish(picture(2), t_s + ENOUGH_S - 1e-4)  # exposure began just before t
    fake.finish(picture(3), t_s + ENOUGH_S + 1e-4)
    frame = await camera.frame_after(t_s)
    assert frame.image.tolist() == [[3] * WIDTH] * HEIGHT
    assert frame.image.dtype == np.uint8
    assert not frame.image.flags.writeable
    assert frame.timestamp_s == pytest.approx(t_s + ENOUGH_S + 1e-4, abs=2e-6)
    assert frame.earliest_light_s == pytest.approx(t_s + 1e-4, abs=2e-6)
    assert (frame.sequence, frame.pixel_format, frame.white) == (2, "GREY", 255)
    assert frame.exposure_s == pytest.approx(EXPOSURE_S)
    assert frame.stamp_source is StampSource.END_OF_FRAME
    assert frame.flags & MONOTONIC
    assert camera.stats.stale_count == 2


async def test_a_start_of_exposure_stamp_needs_only_the_margin(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    flags = MONOTONIC | START_OF_EXPOSURE
    fake.finish(picture(1), t_s + MARGIN_S - 1e-4, flags=flags)
    fake.finish(picture(2), t_s + MARGIN_S + 1e-4, flags=flags)
    frame = await camera.frame_after(t_s)
    assert frame.image[0, 0] == 2
    assert frame.stamp_source is StampSource.START_OF_EXPOSURE


async def test_uvcvideos_start_flag_is_not_believed(fake: FakeCamera, connect: Connect) -> None:
    # v4l2.md 6: flagged SOE, yet taken when the first packet of the frame arrives
    fake.driver = b"uvcvideo"
    camera, t_s = await connect(), past_s()
    flags = MONOTONIC | START_OF_EXPOSURE
    fake.finish(picture(1), t_s + MARGIN_S + 1e-4, flags=flags)
    fake.finish(picture(2), t_s + ENOUGH_S + 1e-4, flags=flags)
    frame = await camera.frame_after(t_s)
    assert frame.image[0, 0] == 2
    assert frame.stamp_source is StampSource.FIRST_PACKET


async def test_without_a_usable_clock_a_frame_must_come_after_the_queue_was_seen_empty(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.controls[0x009A0902].value = 1  # 100 µs
    camera = await connect(exposure_s=1e-4, frame_margin_s=0.0)
    t_s = time.monotonic()
    for level in (1, 2, 3, 4):
        fake.finish(picture(level), 123.0, flags=0)  # in the queue: may be as old as they like
    task = await waiting(fake, camera, t_s)
    await until(lambda: camera.stats.stale_count == 4)
    for level in range(5, 50):
        before = fake.seen["DQBUF"]
        fake.finish(picture(level), 123.0, flags=0)
        await until(lambda before=before: task.done() or fake.seen["DQBUF"] >= before + 2)
        if task.done():
            break
    frame = await task
    assert frame.image[0, 0] >= 5
    assert frame.stamp_source is StampSource.DEQUEUED
    assert t_s <= frame.earliest_light_s <= frame.timestamp_s <= time.monotonic()


async def test_a_cell_that_runs_faster_reads_stamps_on_its_own_scale(
    fake: FakeCamera, connect: Connect
) -> None:
    clock = CellClock(speed=10.0)
    camera = await connect(clock)
    t_s = clock.now_s() - 1.0
    fake.finish(picture(1), (t_s + ENOUGH_S - 1e-3) / 10)  # stamps are wall time
    fake.finish(picture(2), (t_s + ENOUGH_S + 1e-3) / 10)
    frame = await camera.frame_after(t_s)
    assert frame.image[0, 0] == 2
    assert frame.timestamp_s == pytest.approx(t_s + ENOUGH_S + 1e-3, abs=2e-5)


async def test_an_instant_in_the_future_is_waited_for(fake: FakeCamera, connect: Connect) -> None:
    camera = await connect()
    t_s = time.monotonic() + 0.05
    fake.finish(picture(1), t_s - 0.01)
    fake.finish(picture(2), t_s + ENOUGH_S + 0.001)
    assert (await camera.frame_after(t_s)).image[0, 0] == 2
    assert time.monotonic() >= t_s


async def test_the_wait_ends_with_the_frame_that_comes_during_it(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    task = await waiting(fake, camera, t_s)
    fake.finish(picture(9), t_s + 0.5)
    assert (await asyncio.wait_for(task, 600)).image[0, 0] == 9


async def test_nothing_is_asked_of_the_camera_while_it_has_nothing(
    fake: FakeCamera, connect: Connect
) -> None:
    camera = await connect()
    task = await waiting(fake, camera, past_s(), 0.3)
    with pytest.raises(ReplyTimeoutError):
        await task
    assert fake.seen["DQBUF"] == 1


async def test_between_waits_the_event_loop_does_not_watch_the_camera(
    fake: FakeCamera, calls: FakeCalls, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    task = await waiting(fake, camera, t_s)
    (fd,) = calls.open_cameras
    fake.finish(picture(1), t_s + 0.5)
    await task
    # a reader left behind would be called over and over once the next frame is done
    assert not asyncio.get_running_loop().remove_reader(fd)


async def test_a_wait_that_is_cancelled_leaves_the_camera_usable(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    task = await waiting(fake, camera, t_s)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    fake.finish(picture(7), t_s + 0.5)
    assert (await camera.frame_after(t_s)).image[0, 0] == 7


async def test_two_waits_take_turns(fake: FakeCamera, connect: Connect) -> None:
    camera, t_s = await connect(), past_s()
    for n in (1, 2):
        fake.finish(picture(n), t_s + 0.1 * n)
    frames = await asyncio.gather(camera.frame_after(t_s), camera.frame_after(t_s))
    assert [int(frame.image[0, 0]) for frame in frames] == [1, 2]


# -- frames that are refused ----------------------------------------------------------------------


async def test_flagged_short_and_empty_buffers_are_refused_and_counted(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    task = await waiting(fake, camera, t_s)
    later_s = t_s + 0.5
    fake.finish(picture(1), later_s, flags=MONOTONIC | ERROR)
    fake.finish(picture(2), later_s, bytesused=SIZE - 1)
    fake.finish(picture(3), later_s, bytesused=0)
    fake.finish(picture(4), later_s)
    assert (await task).image[0, 0] == 4
    stats = camera.stats
    assert (stats.error_count, stats.short_count, stats.delivered_count) == (1, 2, 1)
    assert stats.dequeued_count == 4
    await until(lambda: len(fake.queued) == 4)  # each went back to the camera


async def test_a_broken_jpeg_is_counted_and_the_next_one_taken(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.formats = ("MJPG",)
    fake.width, fake.height = 64, 48
    good = bytes(cv2.imencode(".jpg", np.full((48, 64), 77, np.uint8))[1])
    noise = np.random.default_rng(1).integers(0, 256, (48, 64), dtype=np.uint8)
    noisy = bytes(cv2.imencode(".jpg", noise)[1])
    camera, t_s = await connect(width=64, height=48), past_s()
    fake.finish(good[:-2], t_s + 0.5)
    fake.finish(noisy[:-1500] + noisy[-1000:], t_s + 0.55)  # both markers, 500 bytes less
    fake.finish(good, t_s + 0.6)
    frame = await camera.frame_after(t_s)
    assert frame.image.shape == camera.shape == (48, 64)
    assert abs(int(frame.image[0, 0]) - 77) <= 1
    assert frame.sequence == 2
    assert camera.stats.broken_count == 2


async def test_sequence_gaps_are_lost_frames_also_over_the_wrap(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    fake.sequence = 2**32 - 1
    fake.finish(picture(1), t_s - 0.5)
    fake.finish(picture(2), t_s - 0.4, lost=2)  # numbers 0 and 1 are missing
    fake.finish(picture(3), t_s + 0.5)
    frame = await camera.frame_after(t_s)
    assert frame.sequence == 3
    assert camera.stats.lost_count == 2


async def test_frames_turned_away_while_nobody_waited_are_not_lost_ones(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    for n in range(4):
        assert fake.finish(picture(n), t_s - 0.9 + 0.1 * n)
    for _ in range(3):
        assert not fake.finish(picture(99), t_s - 0.3)  # no buffer left
    task = await waiting(fake, camera, t_s)
    await until(lambda: len(fake.queued) == 4)
    fake.finish(picture(50), t_s + 0.3)
    assert (await task).sequence == 7
    stats = camera.stats
    assert (stats.idle_gap_count, stats.lost_count, stats.stale_count) == (3, 0, 4)


async def test_the_time_out_says_what_did_come(fake: FakeCamera, connect: Connect) -> None:
    camera, t_s = await connect(), past_s()
    fake.finish(picture(1), t_s - 0.5)
    fake.finish(picture(1), t_s + 0.5, flags=MONOTONIC | ERROR)
    with pytest.raises(ReplyTimeoutError, match=r"1 stale.*1 error"):
        await camera.frame_after(t_s, 0.05)
    with pytest.raises(ReplyTimeoutError, match="no frame came at all"):
        await camera.frame_after(t_s, 0.05)


async def test_the_patience_follows_from_frame_rate_and_exposure(
    fake: FakeCamera, connect: Connect
) -> None:
    clock = CellClock(speed=100.0)
    camera = await connect(clock, exposure_s=0.4, frame_timeout_s=1.0)
    before_s = clock.now_s()
    with pytest.raises(ReplyTimeoutError):
        await camera.frame_after(before_s)
    # at least exposure and margin, four frames of 0.4 s, and the configured second
    assert clock.now_s() - before_s >= 0.4 + MARGIN_S + 4 * 0.4 + 1.0


# -- exposure -------------------------------------------------------------------------------------


async def test_after_a_change_of_exposure_frames_are_skipped(
    fake: FakeCamera, connect: Connect
) -> None:
    camera = await connect(settle_frame_count=2)
    await camera.set_exposure(0.020)
    assert fake.controls[0x009A0902].value == 200  # units of 100 µs
    now_s = time.monotonic()
    task = await waiting(fake, camera, now_s - 1.0)
    fake.finish(picture(1), now_s - 0.5)  # before the change: does not even count as skipped
    for n in (2, 3, 4):
        fake.finish(picture(n), now_s + 0.03 * n)
    frame = await task
    assert frame.image[0, 0] == 4
    assert frame.exposure_s == pytest.approx(0.020)
    assert camera.stats.adapting_count == 3


async def test_a_frame_begun_before_the_change_is_refused_even_if_it_is_late_enough(
    fake: FakeCamera, connect: Connect
) -> None:
    camera = await connect()
    await camera.set_exposure(0.020)
    now_s = time.monotonic()
    fake.finish(picture(1), now_s + 0.010)  # ends after the change, began before it
    fake.finish(picture(2), now_s + 0.026)
    assert (await camera.frame_after(now_s - 1.0)).image[0, 0] == 2


async def test_setting_the_exposure_it_has_costs_no_frame(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(settle_frame_count=3), past_s()
    assert await camera.set_exposure(EXPOSURE_S) == pytest.approx(EXPOSURE_S)
    fake.finish(picture(9), t_s + 0.5)
    assert (await camera.frame_after(t_s)).image[0, 0] == 9
    assert camera.stats.adapting_count == 0


async def test_a_camera_whose_controls_changed_on_connecting_settles_first(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.controls[0x009A0901].value = 3
    camera = await connect(settle_frame_count=1)
    now_s = time.monotonic()
    fake.finish(picture(1), now_s + 0.05)
    fake.finish(picture(2), now_s + 0.15)
    assert (await camera.frame_after(now_s - 1.0)).image[0, 0] == 2


# -- pause and resume -----------------------------------------------------------------------------


async def test_a_paused_camera_makes_no_frames_and_a_resumed_one_does(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    fake.finish(picture(1), t_s + 0.1)
    await camera.pause()
    assert camera.is_paused
    assert not fake.is_streaming
    with pytest.raises(ValueError, match="paused"):
        await camera.frame_after(t_s)
    await camera.resume()
    assert fake.finish(picture(2), t_s + 0.2)
    frame = await camera.frame_after(t_s)
    assert (frame.image[0, 0], frame.sequence) == (2, 0)
    assert camera.stats.lost_count == 0


# -- trouble --------------------------------------------------------------------------------------


async def test_unplugged_in_the_middle_of_a_wait_is_said_and_leaves_nothing_open(
    fake: FakeCamera, calls: FakeCalls, connect: Connect
) -> None:
    camera = await connect()
    task = await waiting(fake, camera, past_s())
    calls.log.clear()
    fake.unplug()
    with pytest.raises(UnpluggedError, match="gone"):
        await asyncio.wait_for(task, 600)
    assert calls.log == ["DQBUF", "STREAMOFF", *["unmap"] * 4, "close"]
    assert not camera.is_connected
    with pytest.raises(LinkError, match="not connected"):
        await camera.frame_after(past_s())


async def test_a_camera_plugged_in_again_is_found_set_and_used(
    fake: FakeCamera, calls: FakeCalls, connect: Connect
) -> None:
    camera = await connect(CellClock(speed=20.0))
    await camera.set_exposure(0.030)
    fake.unplug()
    with pytest.raises(UnpluggedError):
        await camera.frame_after(0.0)
    back = FakeCamera(WIDTH, HEIGHT)
    back.is_gone = True  # the node is there and refuses for a moment
    calls.nodes["/dev/video0"] = back
    task = asyncio.create_task(camera.reconnect(timeout_s=100.0))
    await asyncio.sleep(0)
    back.is_gone = False
    await task
    assert back.controls[0x009A0902].value == 300  # the exposure last asked for
    t_s = 20.0 * time.monotonic()
    back.finish(picture(5), (t_s + 0.1) / 20.0)
    assert (await camera.frame_after(t_s)).image[0, 0] == 5


async def test_reconnecting_gives_up_with_the_last_refusal(
    calls: FakeCalls, connect: Connect
) -> None:
    camera = await connect(CellClock(speed=100.0))
    calls.nodes.clear()
    with pytest.raises(LinkError, match="no camera is plugged in"):
        await camera.reconnect(timeout_s=1.0)


async def test_an_io_error_restarts_the_stream_once(fake: FakeCamera, connect: Connect) -> None:
    camera, t_s = await connect(), past_s()
    fake.fail("DQBUF", errno.EIO)
    task = asyncio.create_task(camera.frame_after(t_s))
    await until(lambda: camera.stats.restart_count == 1)
    assert fake.is_streaming
    fake.finish(picture(6), t_s + 0.5)
    assert (await task).image[0, 0] == 6
    fake.fail("DQBUF", errno.EIO)  # a good frame since then: it may try again
    task = asyncio.create_task(camera.frame_after(t_s))
    await until(lambda: camera.stats.restart_count == 2)
    fake.finish(picture(7), t_s + 0.6)
    assert (await task).image[0, 0] == 7


async def test_an_io_error_after_the_restart_is_a_fault(
    fake: FakeCamera, calls: FakeCalls, connect: Connect
) -> None:
    camera = await connect()
    fake.fail("DQBUF", errno.EIO)
    task = asyncio.create_task(camera.frame_after(past_s()))
    await until(lambda: camera.stats.restart_count == 1)
    fake.finish(picture(1), past_s() - 1.0)
    fake.fail("DQBUF", errno.EIO)
    fake.changed(True)
    with pytest.raises(FaultError, match="after a restart") as caught:
        await asyncio.wait_for(task, 600)
    assert caught.value.code == errno.EIO
    assert calls.is_all_released


async def test_a_node_that_polls_ready_with_nothing_there_is_no_unplug_and_no_spin(
    fake: FakeCamera, calls: FakeCalls, connect: Connect
) -> None:
    # v4l2.md 7.9: POLLERR also means "nothing queued"
    camera, t_s = await connect(), past_s()
    fake.is_stuck_ready = True
    fake.changed(False)
    task = await waiting(fake, camera, t_s, 0.5)
    with pytest.raises(ReplyTimeoutError):
        await task
    # back-off from an eighth of a period to a whole one, 0.1 s: some ten looks, not thousands
    assert 3 <= fake.seen["DQBUF"] <= 15
    assert camera.is_connected


async def test_a_node_that_epoll_refuses_is_looked_at_now_and_then(
    fake: FakeCamera, calls: FakeCalls, connect: Connect, tmp_path: Path
) -> None:
    with (tmp_path / "regular").open("w") as file:  # epoll: EPERM
        calls.readiness_override = file.fileno()
        camera, t_s = await connect(), past_s()
        task = await waiting(fake, camera, t_s)
        fake.finish(picture(3), t_s + 0.5)
        assert (await asyncio.wait_for(task, 600)).image[0, 0] == 3
        assert fake.seen["DQBUF"] < 10


async def test_closing_ends_a_wait_in_progress(fake: FakeCamera, connect: Connect) -> None:
    camera = await connect()
    task = await waiting(fake, camera, past_s())
    await camera.close()
    with pytest.raises(LinkError, match="closed"):
        await asyncio.wait_for(task, 600)
    soon = asyncio.create_task(camera.frame_after(0.0))
    with pytest.raises(LinkError, match="not connected"):
        await soon


async def test_a_buffer_that_does_not_exist_is_a_bad_reply(
    fake: FakeCamera, connect: Connect
) -> None:
    camera, t_s = await connect(), past_s()
    fake.finish(picture(1), t_s + 0.5)
    fake.buffers[0].raw = (9).to_bytes(4, "little") + fake.buffers[0].raw[4:]
    with pytest.raises(BadReplyError, match="buffer 9 of 4"):
        await camera.frame_after(t_s)


async def test_a_cancelled_connect_leaves_nothing_open(fake: FakeCamera, calls: FakeCalls) -> None:
    camera = Camera(config(), REAL_TIME, calls)
    fake.hold = threading.Event()
    task = asyncio.create_task(camera.connect())
    await until(lambda: "QUERYCAP" in fake.log)
    task.cancel()
    fake.hold.set()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert calls.is_all_released
    assert not camera.is_connected


async def test_connecting_twice_is_a_bug(connect: Connect) -> None:
    camera = await connect()
    with pytest.raises(ValueError, match="already connected"):
        await camera.connect()


@pytest.mark.parametrize(
    ("name", "code", "kind", "said"),
    [
        ("S_FMT", errno.EBUSY, RefusedError, "another program"),
        ("REQBUFS", errno.EBUSY, RefusedError, "another program"),
        ("STREAMON", errno.EIO, FaultError, "cable"),
        ("QUERYCAP", errno.ENOTTY, WrongDeviceError, "not a V4L2 node"),
        ("QUERYCAP", errno.ENODEV, UnpluggedError, "gone"),
        ("S_CTRL", errno.ENODEV, UnpluggedError, "gone"),
        ("S_PARM", errno.ENODEV, UnpluggedError, "gone"),
        ("QUERYBUF", errno.ENOTCONN, UnpluggedError, "gone"),
    ],
)
async def test_what_goes_wrong_during_connect_is_told_and_closed(
    fake: FakeCamera,
    calls: FakeCalls,
    name: str,
    code: int,
    kind: type[Exception],
    said: str,
) -> None:
    fake.fail(name, code)
    camera = Camera(config(), REAL_TIME, calls)
    with pytest.raises(kind, match=said):
        await camera.connect()
    assert calls.is_all_released
    await camera.connect()  # the cause gone, it works
    await camera.close()
    assert calls.is_all_released
