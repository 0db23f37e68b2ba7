"""Counters are trusted only if the known state of the axes excludes that they were changed."""

from drivers.umi_scara import Axis
from drivers.umi_scara.motion import judge_counters

COUNTS = dict.fromkeys(Axis, 0) | {Axis.ZED: -500, Axis.WRIST1: -300}
KNOWN = {axis: (counts, counts) for axis, counts in COUNTS.items()}


def test_axes_that_read_what_they_rested_at_are_believed() -> None:
    assert judge_counters(KNOWN, COUNTS, may_be_zeroed=True) == ""


def test_a_resting_axis_that_reads_otherwise_is_named() -> None:
    assert "zed" in judge_counters(KNOWN, COUNTS | {Axis.ZED: 0}, may_be_zeroed=False)


def test_an_axis_under_way_may_be_anywhere_above_tray_and_nowhere_else() -> None:
    known = KNOWN | {Axis.SHOULDER: (0, 1000)}
    assert not judge_counters(known, COUNTS | {Axis.SHOULDER: 400}, may_be_zeroed=True)
    assert "shoulder" in judge_counters(known, COUNTS | {Axis.SHOULDER: -60}, may_be_zeroed=True)


def test_a_board_whose_axes_rest_at_zero_cannot_prove_that_it_was_not_zeroed() -> None:
    known, counts = KNOWN | {Axis.WRIST1: (0, 0)}, COUNTS | {Axis.WRIST1: 0}
    assert "IP0" in judge_counters(known, counts, may_be_zeroed=True)
    assert not judge_counters(known, counts, may_be_zeroed=False)


def test_an_axis_under_way_is_no_witness() -> None:
    known = KNOWN | {Axis.WRIST1: (-400, -200)}
    assert "IP0" in judge_counters(known, COUNTS, may_be_zeroed=True)
