"""Seconds of joint moves, and how far the arm strays from the joint line meanwhile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_cell import emulated_layout

from controller.planning.motion import leg_seconds, leg_tube, move_seconds, tip_pose
from controller.planning.motion._legs import _radii_mm
from controller.planning.motion._pace import leg_course, tube_bound_mm
from controller.planning.motion._scene import Scene
from drivers.umi_scara.kinematics import within_limits

LAYOUT = emulated_layout()
PACE = LAYOUT.pace
NO_SKEW = replace(LAYOUT, pace=replace(PACE, skew_s=0.0))
SPEED = np.array(PACE.joint_per_s)
LOW = np.array([*np.radians([-88.0, -150.0, -120.0]), -870.0, *np.radians([-97.0, -130.0])])
HIGH = np.array([*np.radians([88.0, 140.0, 120.0]), -10.0, *np.radians([3.0, 175.0])])
AT = np.linspace(0.0, 1.0, 101)


def random_rows(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = LOW + rng.random((n, 6)) * (HIGH - LOW)
    return q[within_limits(q)]


def run_motor(travel: float, speed: float, dt_s: float = 1e-4) -> np.ndarray:
    """Return where a motor is after each tick: full throttle, and brakes no later than it must."""
    rate = speed / PACE.ramp_s
    at, v, trace = 0.0, 0.0, [0.0]
    while abs(travel) - at > 1e-9 and len(trace) < 200000:
        must_brake = v * v / (2 * rate) >= abs(travel) - at - v * dt_s
        v = max(rate * dt_s, v - rate * dt_s) if must_brake else min(speed, v + rate * dt_s)
        at = min(abs(travel), at + v * dt_s)
        trace.append(at)
    return np.sign(travel) * np.array(trace)


def test_one_joint_takes_as_long_as_its_trapezoid_run_tick_by_tick() -> None:
    q = np.array([0.1, 0.2, 0.1, -300.0, -0.5, 0.4])
    fixed = PACE.command_s + PACE.motor_s
    for joint in range(4):
        for share_s in (0.02, 0.2, 0.25, 0.3, 1.7):
            goal = q.copy()
            goal[joint] += share_s * SPEED[joint]
            ticks = len(run_motor(share_s * SPEED[joint], SPEED[joint])) - 1
            found = float(leg_seconds(LAYOUT, q, goal)) - fixed
            assert found == pytest.approx(ticks * 1e-4, abs=6e-3)


def test_pitch_and_roll_share_their_motors_so_that_their_times_add() -> None:
    q = np.array([0.1, 0.2, 0.1, -300.0, -1.0, 0.4])
    both, pitch, roll = q.copy(), q.copy(), q.copy()
    pitch[4] += 0.7
    roll[5] += 0.9
    both[4:] += 0.7, 0.9
    seconds = [float(leg_seconds(LAYOUT, q, goal)) for goal in (pitch, roll, both)]
    moving = [s - PACE.command_s - 2 * PACE.motor_s - PACE.ramp_s for s in seconds]
    assert moving[2] == pytest.approx(moving[0] + moving[1])


def test_many_legs_at_once_are_each_as_if_alone() -> None:
    q = random_rows(1, 120)
    together = leg_seconds(LAYOUT, q[None, :20], q[20:60, None])
    assert together.shape == (40, 20)
    for i, j in ((0, 0), (13, 7), (39, 19)):
        assert together[i, j] == leg_seconds(LAYOUT, q[j], q[20 + i])
    assert move_seconds(LAYOUT, q[:30]) == pytest.approx(
        sum(float(leg_seconds(LAYOUT, q[k], q[k + 1])) for k in range(29))
    )


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0))
def test_there_and_back_take_the_same_and_half_the_way_takes_less(seed: int, share: float) -> None:
    rows = random_rows(seed, 12)
    a, b = rows[0], rows[1]
    whole = float(leg_seconds(LAYOUT, a, b))
    assert whole == float(leg_seconds(LAYOUT, b, a))
    part = float(leg_seconds(LAYOUT, a, a + share * (b - a)))
    assert part <= whole + 1e-12
    assert float(leg_seconds(LAYOUT, a, a)) == 0.0


def test_a_move_begins_and_ends_where_it_was_told_whatever_the_skew() -> None:
    rows = random_rows(3, 40)
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        for skew_s in (-0.05, 0.0, 0.05):
            q, done = leg_course(LAYOUT, a, b, 33, skew_s)
            np.testing.assert_allclose(q[0], a, atol=1e-9)
            np.testing.assert_allclose(q[-1], b, atol=1e-9)
            assert done[0] == 0.0
            assert done[-1] == pytest.approx(1.0)
            assert np.all(np.diff(done) >= -1e-12)


def test_motors_run_with_whole_speeds_rounded_up() -> None:
    """Shoulder for 3 s at speed 100; the elbow would need 33.4, gets 34, and waits for the end."""
    a = np.array([-0.5, 0.3, 0.0, -300.0, -0.5, 0.0])
    b = a.copy()
    b[0] += 3.0 * SPEED[0]
    b[1] += 3.0 * SPEED[1] * 0.334
    q, _ = leg_course(NO_SKEW, a, b, 2001)
    end_s = 3.0 + PACE.ramp_s
    t_s = np.linspace(0.0, end_s, 2001)
    for joint, speed in ((0, SPEED[0]), (1, SPEED[1] * 0.34)):
        ran = run_motor(b[joint] - a[joint], speed)
        expected = a[joint] + np.interp(t_s, 1e-4 * np.arange(len(ran)), ran)
        np.testing.assert_allclose(q[:, joint], expected, atol=2e-4)


def test_the_arm_keeps_to_the_line_where_speeds_come_out_whole() -> None:
    a = np.array([-0.6, 0.3, 0.0, -500.0, -0.5, 0.0])
    b = a + 2.5 * SPEED * np.array([0.4, 0.2, 0.1, 0.5, 0.0, 0.0]) / 0.5
    assert leg_tube(NO_SKEW, a, b, AT).max() < 1e-6
    one = a.copy()
    one[2] += 1.0
    assert leg_tube(LAYOUT, a, one, AT).max() < 1e-6


def test_the_tip_stays_inside_the_tube() -> None:
    rows = random_rows(4, 40)[:12]
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        tube = float(leg_tube(LAYOUT, a, b, AT).max())
        line = tip_pose(LAYOUT, a + np.linspace(0, 1, 800)[:, None] * (b - a))[:, :3, 3]
        for skew_s in (-PACE.skew_s, 0.3 * PACE.skew_s, PACE.skew_s):
            tips = tip_pose(LAYOUT, leg_course(LAYOUT, a, b, 60, skew_s)[0])[:, :3, 3]
            away = np.linalg.norm(tips[:, None] - line[None], axis=2).min(axis=1)
            assert away.max() <= tube + 1.0


def test_the_quick_bound_holds_the_tube() -> None:
    scene = Scene(LAYOUT, 60.0, 85.0)
    rows = random_rows(5, 80)
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        bound = tube_bound_mm(LAYOUT, b - a, _radii_mm(scene, a, b))
        assert leg_tube(LAYOUT, a, b, AT).max() <= bound + 1e-6
