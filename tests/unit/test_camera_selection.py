"""Which frame was exposed wholly after an instant: the rule by itself, with time as an input."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.camera_v4l2 import StampSource
from drivers.camera_v4l2.capture.selection import (
    ExposureChange,
    Stamp,
    default_margin_s,
    earliest_light_s,
    sequence_gap,
    stamp_of,
)
from drivers.camera_v4l2.kernel.abi import Buffer

MONOTONIC, COPIED, START = 0x2000, 0x4000, 0x10000  # videodev2.h, V4L2_BUF_FLAG_*
PERIOD_S = 0.1


def stamped(flags: int, at_s: float, *, trusted: bool = True, dequeued_s: float = 10.0) -> Stamp:
    buffer = Buffer(0, 1, flags, round(at_s * 1e6), 0, 0, 1)
    return stamp_of(
        buffer,
        stamp_s=at_s,
        dequeued_s=dequeued_s,
        last_empty_s=9.5,
        period_s=PERIOD_S,
        is_start_trusted=trusted,
    )


def test_a_monotonic_stamp_marks_the_end_of_the_frame_unless_flagged_otherwise() -> None:
    assert stamped(MONOTONIC, 9.9) == Stamp(9.9, 9.9, StampSource.END_OF_FRAME)
    start = Stamp(9.9, 9.9, StampSource.START_OF_EXPOSURE)
    assert stamped(MONOTONIC | START, 9.9) == start


def test_a_start_stamp_that_is_not_trusted_marks_the_first_packet() -> None:
    assert stamped(MONOTONIC | START, 9.9, trusted=False).source is StampSource.FIRST_PACKET


def test_a_stamp_of_another_clock_says_only_that_the_queue_was_empty_before() -> None:
    for flags in (0, COPIED, START):
        assert stamped(flags, 9.9) == Stamp(10.0, 9.5, StampSource.DEQUEUED)


def test_a_stamp_may_be_a_little_ahead_but_not_far_nor_nought() -> None:
    assert stamped(MONOTONIC, 10.19).source is StampSource.END_OF_FRAME
    assert stamped(MONOTONIC, 11.0).source is StampSource.DEQUEUED
    assert stamped(MONOTONIC, 0.0).source is StampSource.DEQUEUED


def test_an_end_stamp_takes_exposure_and_margin_off_and_a_start_stamp_the_margin() -> None:
    end = Stamp(5.0, 5.0, StampSource.END_OF_FRAME)
    start = Stamp(5.0, 5.0, StampSource.START_OF_EXPOSURE)
    assert round(earliest_light_s(end, 0.25, 0.125), 9) == 4.625
    assert round(earliest_light_s(start, 0.25, 0.125), 9) == 4.875


@given(
    began_s=st.floats(1, 100),
    exposure_s=st.floats(1e-4, 1),
    delay=st.floats(0, 1),
    margin_s=st.floats(0.0, 0.5),
    source=st.sampled_from([StampSource.END_OF_FRAME, StampSource.FIRST_PACKET]),
)
def test_no_frame_passes_for_later_than_its_first_light_if_the_margin_covers_the_delay(
    began_s: float, exposure_s: float, delay: float, margin_s: float, source: StampSource
) -> None:
    stamp_s = began_s + exposure_s + delay * margin_s
    bound_s = earliest_light_s(Stamp(stamp_s, stamp_s, source), exposure_s, margin_s)
    assert bound_s <= began_s + 1e-9
    assert bound_s >= began_s - margin_s - 1e-9  # and it is not needlessly strict


def test_a_first_packet_gets_two_periods_until_it_is_measured() -> None:
    assert default_margin_s(StampSource.FIRST_PACKET, 0.04) == 0.08
    assert default_margin_s(StampSource.END_OF_FRAME, 0.04) == 0.04


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**31 - 2))
def test_a_gap_is_counted_over_the_wrap(previous: int, missing: int) -> None:
    assert sequence_gap(previous, (previous + missing + 1) % 2**32) == missing


def test_a_count_that_stands_or_restarts_misses_nothing() -> None:
    assert sequence_gap(7, 7) == 0
    assert sequence_gap(500, 0) == 0


def test_settling_counts_only_frames_stamped_after_the_change() -> None:
    settling = ExposureChange()
    settling.begin(at_s=5.0, frame_count=2)
    ends = [4.9, 5.1, 5.2, 5.3]
    stamps = [Stamp(end, end, StampSource.END_OF_FRAME) for end in ends]
    assert [settling.is_adapting(stamp) for stamp in stamps] == [True, True, True, False]
