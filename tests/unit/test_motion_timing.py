"""Seconds of joint moves, and how far the arm strays from the joint line meanwhile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.planning.motion import move_seconds, segment_seconds, segment_tube, tcp_pose
from controller.planning.motion.scene import Scene
from controller.planning.motion.segments import radii_mm
from controller.planning.motion.timing import tube_bound_mm
from drivers.umi_scara.model.kinematics import within_limits

LAYOUT = emulated_layout()
TIMING = LAYOUT.arm.timing
NO_SKEW = replace(LAYOUT, arm=replace(LAYOUT.arm, timing=replace(TIMING, skew_s=0.0)))
SPEED = TIMING.joint_speeds
LOW = np.array([*np.radians([-88.0, -150.0, -120.0]), -870.0, *np.radians([-97.0, -130.0])])
HIGH = np.array([*np.radians([88.0, 140.0, 120.0]), -10.0, *np.radians([3.0, 175.0])])
AT = np.linspace(0.0, 1.0, 101)


def random_rows(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = LOW + rng.random((n, 6)) * (HIGH - LOW)
    return q[within_limits(q)]


def test_many_legs_at_once_are_each_as_if_alone() -> None:
    q = random_rows(1, 120)
    together = segment_seconds(LAYOUT, q[None, :20], q[20:60, None])
    assert together.shape == (40, 20)
    for i, j in ((0, 0), (13, 7), (39, 19)):
        assert together[i, j] == segment_seconds(LAYOUT, q[j], q[20 + i])
    assert move_seconds(LAYOUT, q[:30]) == pytest.approx(
        sum(float(segment_seconds(LAYOUT, q[k], q[k + 1])) for k in range(29))
    )


def test_the_arm_keeps_to_the_line_where_speeds_come_out_whole() -> None:
    a = np.array([-0.6, 0.3, 0.0, -500.0, -0.5, 0.0])
    b = a + 2.5 * SPEED * np.array([0.4, 0.2, 0.1, 0.5, 0.0, 0.0]) / 0.5
    assert segment_tube(NO_SKEW, a, b, AT).max() < 1e-6
    one = a.copy()
    one[2] += 1.0
    assert segment_tube(LAYOUT, a, one, AT).max() < 1e-6


def test_the_tip_stays_inside_the_tube() -> None:
    rows = random_rows(4, 40)[:12]
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        tube = float(segment_tube(LAYOUT, a, b, AT).max())
        line = tcp_pose(LAYOUT, a + np.linspace(0, 1, 800)[:, None] * (b - a))[:, :3, 3]
        for skew_s in (-TIMING.skew_s, 0.3 * TIMING.skew_s, TIMING.skew_s):
            tips = tcp_pose(LAYOUT, TIMING.course(a, b, 60, skew_s)[0])[:, :3, 3]
            away = np.linalg.norm(tips[:, None] - line[None], axis=2).min(axis=1)
            assert away.max() <= tube + 1.0


def test_the_quick_bound_holds_the_tube() -> None:
    scene = Scene(LAYOUT, 60.0, 85.0)
    rows = random_rows(5, 80)
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        bound = tube_bound_mm(LAYOUT, b - a, radii_mm(scene, a, b))
        assert segment_tube(LAYOUT, a, b, AT).max() <= bound + 1e-6
