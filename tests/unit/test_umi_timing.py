"""Seconds of the arm's moves, and where its joints are meanwhile: motors run tick by tick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.umi_scara import UmiTiming
from drivers.umi_scara.model.kinematics import JOINT_RANGES, within_limits

TIMING = UmiTiming()
SPEED = TIMING.joint_speeds


def random_rows(seed: int, n: int) -> np.ndarray:
    low, high = JOINT_RANGES
    q = low + np.random.default_rng(seed).random((n, 6)) * (high - low)
    return q[within_limits(q)]


def run_motor(travel: float, speed: float, dt_s: float = 1e-4) -> np.ndarray:
    """Return where a motor is after each tick: full throttle, and brakes no later than it must."""
    rate = speed / TIMING.ramp_s
    at, v, trace = 0.0, 0.0, [0.0]
    while abs(travel) - at > 1e-9 and len(trace) < 200000:
        must_brake = v * v / (2 * rate) >= abs(travel) - at - v * dt_s
        v = max(rate * dt_s, v - rate * dt_s) if must_brake else min(speed, v + rate * dt_s)
        at = min(abs(travel), at + v * dt_s)
        trace.append(at)
    return np.sign(travel) * np.array(trace)


def test_one_joint_takes_as_long_as_its_trapezoid_run_tick_by_tick() -> None:
    q = np.array([0.1, 0.2, 0.1, -300.0, -0.5, 0.4])
    fixed = TIMING.command_s + TIMING.motor_s
    for joint in range(4):
        for share_s in (0.02, 0.2, 0.25, 0.3, 1.7):
            goal = q.copy()
            goal[joint] += share_s * SPEED[joint]
            ticks = len(run_motor(share_s * SPEED[joint], SPEED[joint])) - 1
            found = float(TIMING.move_seconds(q, goal)) - fixed
            assert found == pytest.approx(ticks * 1e-4, abs=6e-3)


def test_pitch_and_roll_share_their_motors_so_that_their_times_add() -> None:
    q = np.array([0.1, 0.2, 0.1, -300.0, -1.0, 0.4])
    both, pitch, roll = q.copy(), q.copy(), q.copy()
    pitch[4] += 0.7
    roll[5] += 0.9
    both[4:] += 0.7, 0.9
    seconds = [float(TIMING.move_seconds(q, goal)) for goal in (pitch, roll, both)]
    moving = [s - TIMING.command_s - 2 * TIMING.motor_s - TIMING.ramp_s for s in seconds]
    assert moving[2] == pytest.approx(moving[0] + moving[1])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0))
def test_there_and_back_take_the_same_and_half_the_way_takes_less(seed: int, share: float) -> None:
    rows = random_rows(seed, 12)
    a, b = rows[0], rows[1]
    whole = float(TIMING.move_seconds(a, b))
    assert whole == float(TIMING.move_seconds(b, a))
    part = float(TIMING.move_seconds(a, a + share * (b - a)))
    assert part <= whole + 1e-12
    assert float(TIMING.move_seconds(a, a)) == 0.0


def test_a_move_begins_and_ends_where_it_was_told_whatever_the_skew() -> None:
    rows = random_rows(3, 40)
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        for skew_s in (-0.05, 0.0, 0.05):
            q, done = TIMING.course(a, b, 33, skew_s)
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
    q, _ = replace(TIMING, skew_s=0.0).course(a, b, 2001)
    end_s = 3.0 + TIMING.ramp_s
    t_s = np.linspace(0.0, end_s, 2001)
    for joint, speed in ((0, SPEED[0]), (1, SPEED[1] * 0.34)):
        ran = run_motor(b[joint] - a[joint], speed)
        expected = a[joint] + np.interp(t_s, 1e-4 * np.arange(len(ran)), ran)
        np.testing.assert_allclose(q[:, joint], expected, atol=2e-4)
