"""Legs that pass for free are free between the states that were looked at, and as really driven."""

from __future__ import annotations

import numpy as np
from planning_cell import emulated_layout

from controller.planning import Box
from controller.planning.motion import Scene, connect, path_free, tcp_pose
from controller.planning.motion.segments import PathEnds, radii_mm, segment_free
from drivers.umi_scara.model.kinematics import within_limits

LAYOUT = emulated_layout()
HELD = Box.from_bounds(-25.0, 45.0, -30.0, 30.0, -20.0, 20.0)
SCENE = Scene(LAYOUT, 60.0, 85.0, carried=HELD)
LOW = np.array([*np.radians([-88.0, -150.0, -120.0]), -700.0, *np.radians([-97.0, -130.0])])
HIGH = np.array([*np.radians([88.0, 140.0, 120.0]), -10.0, *np.radians([3.0, 175.0])])


def free_rows(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = LOW + rng.random((n, 6)) * (HIGH - LOW)
    q = q[within_limits(q)]
    return q[SCENE.free(q, 12.0)]


def segments(seed: int, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rows = free_rows(seed, 9 * n)
    rng = np.random.default_rng(seed)
    pairs = []
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        pairs.append((a, a + (b - a) * rng.uniform(0.2, 1.0)))
    return pairs[:n]


def dense(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a + np.linspace(0, 1, 500)[:, None] * (b - a)


def test_a_free_leg_is_free_at_every_state_on_and_off_the_line() -> None:
    found = []
    for a, b in segments(1, 24):
        ends = PathEnds.of(LAYOUT, a, b)
        found.append(segment_free(SCENE, a, b, ends))
        line = dense(a, b)
        if found[-1]:
            assert SCENE.free(line, 0.0).all()
            timing = LAYOUT.arm.timing
            for skew_s in (-timing.skew_s, timing.skew_s):
                driven, _ = timing.course(a, b, 200, skew_s)
                assert SCENE.free(driven, 0.0).all()
        else:
            assert not SCENE.free(line, 45.0).all(), "refused with plenty of room"
    assert 5 < sum(found) < 22


def test_a_pin_thinner_than_the_steps_is_not_stepped_over() -> None:
    """Needles put anywhere on the way of the part, 0.4 mm thick."""
    rng = np.random.default_rng(7)
    tried = 0
    for a, b in segments(2, 40):
        ends = PathEnds.of(LAYOUT, a, b)
        if not segment_free(SCENE, a, b, ends):
            continue
        at = tcp_pose(LAYOUT, a + rng.uniform(0.2, 0.8) * (b - a))[:3, 3]
        half = np.array([0.2, 0.2, 30.0])
        T = np.eye(4)
        T[:3, 3] = at
        pinned = Scene(LAYOUT, 60.0, 85.0, carried=HELD, standing=(Box(T, half),))
        assert not segment_free(pinned, a, b, ends)
        tried += 1
    assert tried > 8


def test_nothing_moves_farther_than_the_radii_allow() -> None:
    far, beside = SCENE.reach_mm()
    assert far > LAYOUT.arm.tool_mm
    assert beside > 50.0
    corners = np.array(np.meshgrid(*[[-h, h] for h in HELD.half_mm])).reshape(3, -1)
    local = HELD.T[:3, :3] @ corners + HELD.T[:3, 3:4]
    for a, b in segments(3, 20):
        bound = float(np.abs(b - a) @ radii_mm(SCENE, a, b))
        T = tcp_pose(LAYOUT, dense(a, b))
        points = T[:, :3, :3] @ local + T[:, :3, 3:4]
        way = np.linalg.norm(np.diff(points, axis=0), axis=1).sum(axis=0)
        assert way.max() <= bound + 1e-6


def test_a_way_is_the_same_each_time_and_free_when_asked_again() -> None:
    post = Box.from_bounds(300.0, 330.0, -60.0, -30.0, 0.0, 700.0)  # between left and right
    scene = Scene(LAYOUT, 60.0, 85.0, carried=HELD, standing=(post,))
    rows = free_rows(5, 400)
    rows = rows[scene.free(rows, 12.0) & (rows[:, 3] < -250.0)]
    left, right = rows[rows[:, 0] > 0.5][:3], rows[rows[:, 0] < -0.5][:3]
    several = 0
    for a, b in zip(left, right, strict=True):
        way = connect(a, b, scene, "test", search=True)
        again = connect(a, b, scene, "test", search=True)
        np.testing.assert_array_equal(np.stack(way), np.stack(again))
        np.testing.assert_array_equal(way[-1], b)
        assert path_free(scene, [a, *way])
        several += len(way) > 1
    assert several > 0
