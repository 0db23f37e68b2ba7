"""Homing: the host's procedure of umi_rtx.md 4.1 as bytes, and the IPs' own routines.

Sections (§) are those of umi_rtx.md.
"""

import pytest
from emu_umi_line import Line

from emulators.umi_scara import Axis

# umi_rtx.md 4.2: what homing writes, and the true stops that it was written at
LABELS = {
    Axis.WRIST1: -3101,
    Axis.WRIST2: 459,
    Axis.ELBOW: -2629,
    Axis.SHOULDER: 2630,
    Axis.ZED: 0,
    Axis.YAW: -1947,
    Axis.GRIPPER: 0,
}
STOPS = {
    Axis.WRIST1: (-2642 - 3560) / 2,
    Axis.WRIST2: (-2642 + 3560) / 2,
    Axis.ELBOW: -2629.0,
    Axis.SHOULDER: 2630.0,
    Axis.ZED: 0.0,
    Axis.YAW: -1947.0,
    Axis.GRIPPER: 0.0,  # 30 counts open from fully closed
}
# [counts]: the gripper's 0 is where a numeric move ended, which is told up to DEAD_BAND too early;
# in the corner of the wrist two motors push on two shared stops, and friction has the last word
TOLERANCE = {Axis.GRIPPER: 2.0, Axis.WRIST1: 0.1, Axis.WRIST2: 0.1}
SPEED, ERROR_LIMIT, MAX_FORCE, NEW_POSITION = 4, 2, 10, 3


def drive(line: Line, directions: dict[Axis, int]) -> None:
    """Dead stop both IPs, manual go, wait until bit 3 of every driven motor is set; 4.1."""
    line.stop_both("24")
    line.drive(directions)
    line.wait_for(3, 1, *directions)
    line.run(("80 00 00", "00"))


def go_to(line: Line, axis: Axis, counts: int) -> None:
    line.write(axis, NEW_POSITION, counts)
    assert line.go(axis) == "00"
    line.wait_for(0, 0, axis)


def home_as_uva(line: Line) -> None:
    """The recommended procedure, column U of umi_rtx.md 4.1."""
    line.write(Axis.ZED, SPEED, 30)
    line.write(Axis.ZED, MAX_FORCE, 30)
    drive(line, {Axis.ZED: +1})
    line.stop_both("21")
    line.write(Axis.GRIPPER, MAX_FORCE, 20)
    drive(line, {Axis.GRIPPER: -1})
    line.stop_both("21")
    line.stop_both("22")
    go_to(line, Axis.GRIPPER, 30)
    line.stop_both("21")
    line.stop_both("22")
    line.write(Axis.YAW, MAX_FORCE, 0)
    go_to(line, Axis.ELBOW, 440)
    line.stop_both("21")
    line.stop_both("22")
    for _ in range(2):
        drive(line, {Axis.WRIST1: -1, Axis.WRIST2: +1})
        drive(line, {Axis.WRIST1: -1, Axis.WRIST2: -1})
    line.stop_both("21")
    line.stop_both("22")
    drive(line, {Axis.SHOULDER: +1})
    line.stop_both("21")
    line.stop_both("22")
    line.write(Axis.ELBOW, SPEED, 80)
    line.write(Axis.ELBOW, MAX_FORCE, 30)
    line.write(Axis.YAW, SPEED, 100)
    line.write(Axis.YAW, MAX_FORCE, 60)
    line.write(Axis.YAW, ERROR_LIMIT, 1500)
    drive(line, {Axis.ELBOW: -1, Axis.YAW: -1})
    line.stop_both("21")
    line.stop_both("22")
    for axis, counts in LABELS.items():
        line.label(axis, counts)


@pytest.mark.parametrize("seed", range(8))
def test_the_hosts_homing_finds_every_stop_from_any_cold_pose(seed: int) -> None:
    line = Line(seed=seed)
    home_as_uva(line)
    for axis, stop in STOPS.items():
        assert line.true(axis) == pytest.approx(stop, abs=TOLERANCE.get(axis, 1e-6)), axis
        assert (line.counter(axis), line.error(axis)) == (LABELS[axis], 0)
        # the labels are rounded to whole counts: elbow by one, yaw by 0.67; umi_rtx.md 4.2
        assert abs(line.counter(axis) - line.true(axis)) <= max(1.0, TOLERANCE.get(axis, 0))


@pytest.mark.parametrize("seed", [0, 3])
def test_after_homing_the_arm_parks_where_its_counters_say(seed: int) -> None:
    line = Line(seed=seed)
    home_as_uva(line)
    for axis in Axis:
        line.write(axis, NEW_POSITION, -18 if axis is Axis.ZED else 0)
    line.on(1).run(("bf", "00"))
    line.on(0).run(("ac", "00"))
    for ip in (0, 1):
        for _ in range(100):
            if line.on(ip).ask("17") == "17 00 00":
                break
            line.pass_time(0.2)
        line.run(("17", "17 00 00"))  # none of the bits 2, 3, 5: a healthy homed arm; §2.8
    line.pass_time(0.5)
    for axis in Axis:
        assert line.counter(axis) == (-18 if axis is Axis.ZED else 0)
        assert line.true(axis) == pytest.approx(line.counter(axis), abs=TOLERANCE.get(axis, 1.0))


def test_both_homing_motors_at_iLab_speed_end_in_the_same_corner() -> None:  # noqa: N802 -- a name
    line = Line(seed=5)
    for axis in (Axis.ELBOW, Axis.YAW):
        line.write(axis, SPEED, 30)
        line.write(axis, MAX_FORCE, 20)
    line.write(Axis.YAW, ERROR_LIMIT, 1500)
    drive(line, {Axis.ELBOW: -1, Axis.YAW: -1})
    assert line.true(Axis.ELBOW) == STOPS[Axis.ELBOW]
    assert line.true(Axis.YAW) == pytest.approx(STOPS[Axis.YAW])


def test_the_yaw_gives_up_by_following_error_when_its_limit_is_left_at_the_default() -> None:
    line = Line(seed=5)
    line.model.place({Axis.ELBOW: 2000.0, Axis.YAW: 0.0})
    line.stop_both("24")
    line.drive({Axis.ELBOW: -1, Axis.YAW: -1})
    line.wait_for(0, 0, Axis.ELBOW, Axis.YAW)
    assert line.status(Axis.YAW) == 0x06
    assert line.true(Axis.YAW) > STOPS[Axis.YAW] + 100


def test_homing_finds_an_obstacle_where_it_should_find_a_stop() -> None:
    line = Line(seed=2)
    line.model.obstruct(Axis.SHOULDER, +1, blocked=True)
    at = line.true(Axis.SHOULDER)
    drive(line, {Axis.SHOULDER: +1})
    assert line.true(Axis.SHOULDER) == at != STOPS[Axis.SHOULDER]


def wait_for_init(line: Line, ip: int, limit_s: float = 80.0) -> float:
    started_s = line.now_s
    while int(line.on(ip).ask("17")[3:5], 16) & 1:
        assert line.now_s - started_s < limit_s  # umi_rtx.md 2.3: UvA waits 16 x 5 s
        line.pass_time(0.5)
    return line.now_s - started_s


@pytest.mark.parametrize("seed", [0, 4, 9])
def test_the_built_in_homing_keeps_bit_0_set_labels_the_stops_and_ends_at_0(seed: int) -> None:
    line = Line(seed=seed)
    for ip, axes in ((0, [Axis.WRIST1, Axis.WRIST2]), (1, [Axis.ZED, Axis.ELBOW, Axis.YAW])):
        line.on(ip).run(("08", "00"))
        assert all(line.status(axis) & 1 for axis in axes)
        line.on(ip).run(("ac", "03"))
        assert wait_for_init(line, ip) > 1.0
    line.pass_time(0.5)
    for axis in Axis:
        assert (line.counter(axis), line.error(axis)) == (0, 0)
        assert line.true(axis) == pytest.approx(0.0, abs=1.01)
    line.on(1).run(("60 02 00", "c0"), ("6b", "d5 e8 03"))  # yaw ERROR_LIMIT is 1000 again


@pytest.mark.parametrize("stop", ["24", "25", "26", "80 00 00", "20"])
def test_a_stop_ends_the_built_in_homing(stop: str) -> None:
    line = Line(seed=1)
    line.on(1).run(("08", "00"))
    line.pass_time(0.3)
    line.run((stop, "00"))
    line.pass_time(1.0)
    at = line.model.joints()
    line.pass_time(2.0)
    assert line.model.joints() == at


def test_a_built_in_homing_stopped_at_the_elbow_leaves_no_limit_changed() -> None:
    line = Line(seed=1)
    line.on(1).run(("08", "00"))
    yaw = line.model.axes[Axis.YAW]
    for _ in range(200):
        if yaw.is_busy:
            break
        line.pass_time(0.1)
    line.run(("60 02 00", "c0"), ("6b", "d4 dc 05"), ("24", "00"))  # 1500, umi_rtx.md 4.1
    line.run(("60 02 00", "c0"), ("6b", "d5 e8 03"), ("17", "17 0a 00"))


def test_the_soak_test_runs_until_it_is_stopped() -> None:
    line = Line(seed=1)
    line.on(0).run(("09", "00"))
    seen = set()
    for _ in range(40):
        line.pass_time(0.5)
        seen.add(round(line.true(Axis.WRIST1)))
        line.run(("ac", "03"))
    assert len(seen) > 5
    line.run(("0b", "00"))
    at = line.model.joints()
    line.pass_time(1.0)
    assert line.model.joints() == at
    assert line.status(Axis.WRIST1) & 0x03 == 0x02


def test_init_and_soak_homes_first() -> None:
    line = Line(seed=1)
    line.on(1).run(("0a", "00"))
    for _ in range(600):
        line.pass_time(0.1)
        if line.model.axes[Axis.ELBOW].origin == pytest.approx(0.0, abs=1e-6):
            break
    # homed: the counters are true; then the soak goes on
    assert line.model.axes[Axis.ELBOW].origin == pytest.approx(0.0, abs=1e-6)
    line.pass_time(15.0)
    line.run(("bf", "03"), ("0b", "00"))


def test_built_in_homing_without_power_does_nothing() -> None:
    line = Line(seed=1)
    line.on(1).run(("26", "00"))
    at = line.model.joints()
    line.run(("08", "00"), ("17", "17 02 00"))
    line.pass_time(1.0)
    assert line.model.joints() == at
