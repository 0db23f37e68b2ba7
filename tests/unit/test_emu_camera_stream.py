"""When the emulated camera exposes, what its pictures become, and faults on request."""

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from emu_camera_bench import EPOCH_MONOTONIC_S, SPEED, Bench
from emu_camera_client import BRIGHTNESS, ERROR, EXPOSURE, EXPOSURE_AUTO, GAIN, MONOTONIC, SOE
from hypothesis import given
from hypothesis import strategies as st

from emulators.camera_v4l2 import CameraConfig, ClockPattern, Faults, read_clock_pattern
from emulators.camera_v4l2.device.shutter import FrameGrid
from emulators.camera_v4l2.kernel.formats import PixelFormat, encode

POLLIN = 0x0001
PERIOD_S = 0.1
EXPOSURE_S = 0.02
START_S = 7.0  # world time of STREAMON in these tests


def streaming(buffer_count: int = 4, config: CameraConfig | None = None) -> Bench:
    """Return a bench whose camera began to stream at START_S, exposing for EXPOSURE_S."""
    bench = Bench(config)
    bench.client.set(EXPOSURE_AUTO, 1)
    bench.client.set(EXPOSURE, round(EXPOSURE_S / 100e-6))
    bench.clock.world_s = START_S
    bench.client.start(buffer_count)
    return bench


def end_s(frame: int) -> float:
    """Return when a frame's exposure ends, by hand."""
    return START_S + frame * PERIOD_S + EXPOSURE_S


# -- which frames are taken -------------------------------------------------------------------


def test_a_picture_is_ordered_when_its_exposure_is_over_and_not_before() -> None:
    bench = streaming()
    assert bench.at(START_S + 0.5 * EXPOSURE_S) == pytest.approx(end_s(0))
    assert bench.source.asked == []
    assert bench.at(end_s(0) + 1e-6) == pytest.approx(end_s(1))
    (asked,) = bench.source.asked
    assert asked == pytest.approx((START_S, end_s(0), EXPOSURE_S, 1.0))


def test_each_frame_is_ordered_once_however_often_the_clock_is_looked_at() -> None:
    bench = streaming()
    for _ in range(5):
        bench.at(end_s(0) + 0.01)
    assert len(bench.source.asked) == 1


def test_frames_are_numbered_by_time_not_by_pictures() -> None:
    bench = streaming()
    bench.at(end_s(0) + 0.001)
    bench.at(end_s(5) + 0.001)  # the loop was held up: 1 to 4 are lost
    bench.deliver(0)
    bench.deliver(1)
    assert [bench.client.dequeue().sequence for _ in range(2)] == [0, 5]
    assert bench.device.lost_count == 4


def test_without_a_buffer_nothing_is_ordered_and_the_numbers_run_on() -> None:
    bench = streaming(buffer_count=1)
    bench.at(end_s(0) + 0.001)
    bench.deliver(0)
    assert bench.at(end_s(50)) is None  # sleeps: no tick while nothing is queued
    frame = bench.client.dequeue()
    assert frame.sequence == 0
    bench.clock.world_s = end_s(50) + 0.03
    bench.client.queue(frame.index)
    assert bench.at(end_s(50) + 0.04) == pytest.approx(end_s(51))
    assert len(bench.source.asked) == 1  # 50 had ended before the buffer came
    bench.at(end_s(51) + 0.001)
    bench.deliver(1)
    assert bench.client.dequeue().sequence == 51


def test_a_buffer_queued_during_an_exposure_gets_that_frame() -> None:
    bench = streaming(buffer_count=1)
    bench.at(end_s(0) + 0.001)
    bench.deliver(0)
    bench.clock.world_s = START_S + 3 * PERIOD_S + 0.5 * EXPOSURE_S
    bench.client.queue(bench.client.dequeue().index)
    bench.at(end_s(3) + 0.001)
    bench.deliver(1)
    assert bench.client.dequeue().sequence == 3


def test_no_more_than_two_pictures_are_in_the_making() -> None:
    bench = streaming(buffer_count=4)
    for frame in range(2):
        bench.at(end_s(frame) + 0.001)
    assert bench.at(end_s(2) + 0.001) is None  # sleeps until a picture comes
    assert len(bench.source.asked) == 2
    bench.clock.world_s = end_s(7) + 0.01
    bench.deliver(0)
    bench.at(end_s(7) + 0.02)
    assert len(bench.source.asked) == 2  # 7 had ended while both were in the making
    bench.at(end_s(8) + 0.001)
    bench.deliver(1)
    bench.deliver(2)
    assert [bench.client.dequeue().sequence for _ in range(3)] == [0, 1, 8]


def test_pictures_that_overtake_each_other_come_out_in_order() -> None:
    bench = streaming()
    bench.at(end_s(0) + 0.001)
    bench.at(end_s(1) + 0.001)
    bench.deliver(1, level=11)
    assert bench.bits == 0
    bench.deliver(0, level=10)
    for number, level in ((0, 10), (1, 11)):
        frame = bench.client.dequeue()
        assert (frame.sequence, bench.memory.slots[frame.offset_bytes][0]) == (number, level)


def test_a_picture_that_never_comes_frees_its_buffer() -> None:
    bench = streaming(buffer_count=1)
    bench.at(end_s(0) + 0.001)
    bench.device.abandon(0)
    bench.at(end_s(1) + 0.001)
    bench.deliver(1)
    assert bench.client.dequeue().sequence == 1


def test_a_source_that_is_busy_loses_the_frame_only() -> None:
    bench = streaming(buffer_count=1)
    bench.source.refuses = True
    bench.at(end_s(0) + 0.001)
    bench.source.refuses = False
    bench.at(end_s(1) + 0.001)
    bench.deliver(0)
    assert bench.client.dequeue().sequence == 1
    assert bench.device.lost_count == 1


def test_a_new_stream_counts_from_zero() -> None:
    bench = streaming()
    bench.at(end_s(9))
    bench.client.stream_off()
    bench.clock.world_s = 20.0
    for index in range(4):
        bench.client.queue(index)
    bench.client.stream_on()
    bench.at(20.0 + EXPOSURE_S + 0.001)
    bench.deliver(len(bench.source.asked) - 1)
    assert bench.client.dequeue().sequence == 0


@given(
    period_s=st.floats(0.01, 0.5), exposure_part=st.floats(0.001, 3.0), elapsed_s=st.floats(0, 1e4)
)
def test_the_latest_ended_frame_has_ended_and_the_next_has_not(
    period_s: float, exposure_part: float, elapsed_s: float
) -> None:
    grid = FrameGrid(3.0, period_s, lambda _: exposure_part * period_s)
    now_s, slack_s = 3.0 + elapsed_s, 1e-9
    frame = grid.latest_ended(now_s)
    assert frame >= -1
    assert frame == -1 or grid.end_s(frame) <= now_s + slack_s
    assert grid.end_s(frame + 1) > now_s - slack_s
    assert grid.end_s(frame) <= grid.start_s(frame + 1) + slack_s  # frames do not overlap


# -- what a frame says of itself --------------------------------------------------------------


def test_a_frame_is_stamped_when_its_exposure_ended_on_the_clients_clock() -> None:
    bench = streaming()
    bench.at(end_s(3) + 0.005)
    bench.clock.world_s = end_s(3) + 5.0  # the picture took long
    bench.deliver(0)
    frame = bench.client.dequeue()
    assert frame.stamp_us == pytest.approx((EPOCH_MONOTONIC_S + end_s(3) / SPEED) * 1e6, abs=1.5)
    assert frame.flags & (0xE000 | SOE | ERROR) == MONOTONIC
    assert frame.used_bytes == 64 * 48


def test_a_camera_that_stamps_the_start_says_so() -> None:
    config = CameraConfig(sizes_px=((64, 48),), stamps_exposure_start=True)
    bench = streaming(config=config)
    bench.at(end_s(0) + 0.001)
    bench.deliver(0)
    frame = bench.client.dequeue()
    assert frame.stamp_us == pytest.approx((EPOCH_MONOTONIC_S + START_S / SPEED) * 1e6, abs=1.5)
    assert frame.flags & SOE


def test_an_exposure_longer_than_the_period_is_cut_to_it() -> None:
    bench = streaming()
    bench.client.set(EXPOSURE, 5000)  # 0.5 s at 10 Hz
    bench.at(START_S + 4 * PERIOD_S + 0.001)
    assert bench.source.asked[0][2] == pytest.approx(PERIOD_S)


# -- controls take effect with frames ---------------------------------------------------------


def test_an_exposure_set_during_a_frame_shows_in_the_next() -> None:
    bench = streaming()
    bench.clock.world_s = START_S + 0.5 * EXPOSURE_S
    bench.client.set(EXPOSURE, 500)
    bench.client.set(GAIN, 100)
    bench.at(end_s(0) + 0.001)
    bench.at(START_S + PERIOD_S + 0.0501)
    before, after = bench.source.asked
    assert before[2:] == pytest.approx((EXPOSURE_S, 1.0))
    assert after[2:] == pytest.approx((0.05, 10.0))  # gain 100 is 20 dB


def test_a_camera_may_take_frames_to_obey() -> None:
    bench = streaming()
    bench.device.faults = Faults(control_delay_frames=2)
    bench.client.set(GAIN, 100)  # at the instant frame 0 begins
    gains = []
    for frame in range(4):
        bench.at(end_s(frame) + 0.001)
        bench.deliver(frame)
        gains.append(round(bench.source.asked[-1][3]))
    assert gains == [1, 1, 10, 10]
    assert bench.client.get(GAIN) == 100  # though it says so at once


def test_aperture_priority_steers_towards_a_middle_grey() -> None:
    bench = Bench()
    bench.client.start(4)
    exposures = []
    for frame in range(25):
        bench.at((frame + 1) * PERIOD_S)
        exposure_s = bench.source.asked[-1][2]
        exposures.append(exposure_s)
        bench.deliver(frame, level=min(255, round(exposure_s * 3000)))
        bench.client.queue(bench.client.dequeue().index)
    assert exposures[-1] * 3000 == pytest.approx(118, rel=0.05)
    assert max(b / a for a, b in pairwise(exposures)) < 2.05


def test_brightness_is_added_and_clipped() -> None:
    bench = streaming()
    bench.client.set(BRIGHTNESS, 30)
    bench.at(end_s(1) + 0.001)
    bench.deliver(0, level=240)
    assert set(bench.memory.slots[bench.client.dequeue().offset_bytes]) == {255}


# -- pixel formats ----------------------------------------------------------------------------


RAMP = np.arange(64 * 48, dtype=np.uint32).reshape(48, 64)
GREY_RAMP = (RAMP % 251).astype(np.uint8)
DEEP_RAMP = (RAMP * 21).astype(np.uint16)


def decode_grey(jpeg: bytes) -> npt.NDArray[np.uint8]:
    grey = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    return np.asarray(grey, np.uint8)


def test_grey_is_the_picture_row_by_row() -> None:
    assert bytes(encode(GREY_RAMP, PixelFormat.GREY)) == GREY_RAMP.tobytes()
    assert encode(DEEP_RAMP, PixelFormat.GREY)[5] == DEEP_RAMP[0, 5] // 256


def test_yuyv_holds_luma_at_even_bytes_and_no_colour() -> None:
    frame = np.frombuffer(encode(GREY_RAMP, PixelFormat.YUYV), np.uint8)
    assert np.array_equal(frame[0::2].reshape(48, 64), GREY_RAMP)
    assert set(frame[1::2]) == {128}


def test_y16_is_little_endian_and_full_scale() -> None:
    data = bytes(encode(DEEP_RAMP, PixelFormat.Y16))
    assert data[10] + 256 * data[11] == DEEP_RAMP[0, 5]
    white = bytes(encode(np.full((2, 2), 255, np.uint8), PixelFormat.Y16))
    assert white == b"\xff" * 8


def test_mjpg_is_a_jpeg_near_the_picture() -> None:
    data = bytes(encode(np.full((48, 64), 77, np.uint8), PixelFormat.MJPG))
    assert (data[:2], data[-2:]) == (b"\xff\xd8", b"\xff\xd9")
    assert np.abs(decode_grey(data).astype(int) - 77).max() <= 2


def test_a_smaller_format_bins_the_sensors_pixels() -> None:
    bench = Bench()
    bench.client.set_format(32, 24, "GREY")
    bench.client.start(1)
    bench.at(PERIOD_S)
    checker = np.indices((48, 64)).sum(axis=0) % 2 * 200
    bench.device.deliver(0, checker.astype(np.uint8))
    frame = bench.client.dequeue()
    assert set(bench.memory.slots[frame.offset_bytes]) == {100}
    assert frame.used_bytes == 32 * 24


@pytest.mark.parametrize(
    "picture",
    [np.zeros((10, 10), np.uint8), np.zeros((48, 64), np.float32), np.zeros((48, 64, 3), np.uint8)],
)
def test_a_picture_of_another_shape_is_the_sources_mistake(
    picture: npt.NDArray[np.uint8],
) -> None:
    bench = streaming()
    bench.at(end_s(0) + 0.001)
    with pytest.raises(ValueError, match="picture"):
        bench.device.deliver(0, picture)


def test_the_clock_pattern_can_be_read_back_through_a_jpeg() -> None:
    picture = ClockPattern((640, 512)).paint(123.456789, 9876.5, 0.0157, 1.0)
    grey = decode_grey(bytes(encode(picture, PixelFormat.MJPG)))
    assert read_clock_pattern(grey) == pytest.approx((123.456789, 9876.5))


# -- faults -----------------------------------------------------------------------------------


def frames_of(bench: Bench, count: int) -> list[tuple[int, int, bytes]]:
    """Return flags, bytesused and slot of the next frames, numbered levels as pictures."""
    found = []
    for _ in range(count):
        begun = len(bench.source.asked)
        bench.at(bench.clock.world_s + PERIOD_S)
        if len(bench.source.asked) > begun:
            bench.deliver(begun, level=10 + begun)
        frame = bench.client.dequeue()
        found.append((frame.flags, frame.used_bytes, bench.memory.slots[frame.offset_bytes]))
        bench.client.queue(frame.index)
    return found


def test_the_error_flag_comes_as_often_as_ordered() -> None:
    bench = streaming()
    bench.device.faults = Faults(error_count=2)
    assert [bool(flags & ERROR) for flags, _, _ in frames_of(bench, 4)] == [
        True,
        True,
        False,
        False,
    ]
    assert bench.device.faults == Faults()


def test_a_short_frame_ends_half_way() -> None:
    bench = streaming()
    bench.device.faults = Faults(short_count=1)
    assert [used for _, used, _ in frames_of(bench, 2)] == [64 * 48 // 2, 64 * 48]


def test_a_broken_jpeg_lacks_its_end() -> None:
    bench = Bench()
    bench.client.set_format(64, 48, "MJPG")
    bench.client.start(4)
    bench.device.faults = Faults(broken_jpeg_count=1)
    broken, whole = (data for _, _, data in frames_of(bench, 2))
    assert broken[:2] == whole[:2] == b"\xff\xd8"
    assert (broken[-2:], whole[-2:]) == (b"\0\0", b"\xff\xd9")


def test_a_lost_frame_leaves_a_gap_and_keeps_its_buffer() -> None:
    bench = streaming(buffer_count=1)
    bench.device.faults = Faults(lost_count=2)
    for frame in range(3):
        bench.at(end_s(frame) + 0.001)
    bench.deliver(0)
    assert bench.client.dequeue().sequence == 2


def test_a_stalled_camera_sends_nothing_until_it_recovers() -> None:
    bench = streaming()
    bench.device.faults = Faults(is_stalled=True)
    assert bench.at(end_s(30)) is None
    bench.device.faults = Faults()
    bench.at(end_s(31) + 0.001)
    bench.deliver(0)
    assert bench.client.dequeue().sequence == 31


def test_a_frozen_camera_repeats_its_picture_under_new_numbers() -> None:
    bench = streaming()
    frames_of(bench, 1)
    bench.device.faults = Faults(is_frozen=True)
    frozen = frames_of(bench, 3)
    assert {data[0] for _, _, data in frozen} == {10}
    bench.device.faults = Faults()
    assert frames_of(bench, 1)[0][2][0] == 11


def test_a_camera_with_a_cap_on_its_lens_sees_nothing() -> None:
    bench = streaming()
    bench.device.faults = Faults(is_dark=True)
    assert {data[0] for _, _, data in frames_of(bench, 2)} == {0}
    bench.device.faults = Faults()
    assert frames_of(bench, 1)[0][2][0] == 12


def test_a_late_frame_comes_late_with_the_time_of_its_exposure() -> None:
    bench = streaming()
    bench.device.faults = Faults(late_count=1, late_s=0.35)
    bench.at(end_s(0) + 0.001)
    bench.deliver(0)
    assert bench.device.oldest_due_s is None  # time waits for a picture, not for a fault
    assert bench.at(end_s(0) + 0.05) == pytest.approx(end_s(1))
    assert bench.at(end_s(0) + 0.34) is not None
    assert not bench.bits & POLLIN
    bench.at(end_s(0) + 0.351)
    frame = bench.client.dequeue()
    assert frame.sequence == 0
    assert frame.stamp_us == pytest.approx(1e6 * (EPOCH_MONOTONIC_S + end_s(0) / SPEED), abs=2.0)
    assert bench.device.faults.late_count == 0


def test_a_late_frame_that_holds_the_only_buffer_says_when_it_comes() -> None:
    bench = streaming(buffer_count=1)
    bench.device.faults = Faults(late_count=1, late_s=0.35)
    bench.at(end_s(0) + 0.001)
    bench.deliver(0)
    assert bench.at(end_s(0) + 0.05) == pytest.approx(end_s(0) + 0.35)


def test_an_unknown_clock_is_not_flagged_as_monotonic() -> None:
    bench = streaming()
    bench.device.faults = Faults(timestamp_unknown=True)
    bench.at(end_s(0) + 0.001)
    bench.deliver(0)
    frame = bench.client.dequeue()
    assert frame.flags & 0xE000 == 0
    assert frame.stamp_us < EPOCH_MONOTONIC_S * 1e6


def test_faults_add_up_and_count_down_one_by_one() -> None:
    bench = streaming()
    bench.device.faults = Faults(error_count=1, short_count=2)
    found = [(bool(flags & ERROR), used) for flags, used, _ in frames_of(bench, 3)]
    assert found == [(True, 1536), (False, 1536), (False, 3072)]
    bench.device.faults = replace(bench.device.faults, error_count=1)
    assert frames_of(bench, 1)[0][0] & ERROR
