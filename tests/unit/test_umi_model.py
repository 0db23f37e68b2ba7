"""The arm's model for planning: what random joints cover, what it takes up, how it gets out."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.umi_scara import ArmGeometry, UmiModel
from drivers.umi_scara.model.kinematics import JOINT_RANGES, forward, inverse, within_limits

GEOMETRY = ArmGeometry(upper_mm=240.0, fore_mm=200.0, tool_mm=150.0, wrist_height_mm=900.0)


def box(x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T, np.array([50.0, 40.0, 30.0])


MODEL = UmiModel.of_boxes(
    GEOMETRY,
    {"carriage": box(-10.0, 0.0, 80.0), "upper": box(120.0, 0.0, 80.0), "fore": box(100.0, 0, 0)},
)


def legal_q(seed: int, count: int) -> np.ndarray:
    low, high = JOINT_RANGES
    q = low + np.random.default_rng(seed).random((count, 6)) * (high - low)
    return q[within_limits(q)]


def test_no_joint_gets_beyond_its_range_and_each_gets_to_both_ends() -> None:
    low, high = JOINT_RANGES
    rng = np.random.default_rng(0)
    wide = 1.2 * np.abs(JOINT_RANGES).max(axis=0)
    q = rng.uniform(-wide, wide, (400_000, 6))
    q = q[within_limits(q)]
    # the arm rounds to whole counts
    count = np.array([*np.radians([1 / 29.221, 1 / 14.611, 1 / 9.74]), 1 / 3.75, 0.002, 0.002])
    assert (q >= low - count).all()
    assert (q <= high + count).all()
    assert len(q) > 500
    for joint in range(6):
        for end, towards in ((low[joint], 1e-3), (high[joint], -1e-3)):
            row = np.array([0.0, 0.0, 0.0, -400.0, -0.5, 0.3])
            row[joint] = end + towards
            if joint == 2:  # the yaw motor's ends are reached with the elbow turned likewise
                row[1] = JOINT_RANGES[int(end > 0), 1] + 0.5 * towards
            assert within_limits(row), (joint, end)


def test_joint_limits_hold_where_the_arm_accepts_and_nowhere_else() -> None:
    wide = 1.2 * np.abs(JOINT_RANGES).max(axis=0)
    q = np.random.default_rng(3).uniform(-wide, wide, (200_000, 6))
    allowed = np.ones(len(q), dtype=bool)
    near = np.zeros(len(q), dtype=bool)  # to a limit: rounding decides
    for limit in MODEL.joint_limits:
        value = q @ limit.weights
        allowed &= (value >= limit.low) & (value <= limit.high)
        near |= np.minimum(np.abs(value - limit.low), np.abs(value - limit.high)) < 0.3
    accepted = MODEL.within_limits(q)
    assert not (accepted & ~allowed).any()
    assert np.array_equal(accepted[~near], allowed[~near])
    assert 50 < accepted[~near].sum() < len(q)
    assert [name.rsplit("_", 1)[1] for name in MODEL.joint_names] == ["rad"] * 3 + [
        "mm",
        *["rad"] * 2,
    ]


def test_random_joints_cover_the_ranges_and_are_denser_near_the_top() -> None:
    q = MODEL.spread(np.random.default_rng(1).random((4000, 6)))
    q = q[MODEL.within_limits(q)]
    low, high = JOINT_RANGES
    covered = (q.max(axis=0) - q.min(axis=0)) / (high - low)
    assert (covered > 0.95).all()
    upper_fifth = q[:, 3] > high[3] - 0.2 * (high[3] - low[3])
    assert 0.5 < upper_fifth.mean() < 0.7


def test_what_the_inverse_finds_is_every_branch_within_limits() -> None:
    q = legal_q(2, 400)
    q = q[np.abs(q[:, 4] + np.pi / 2) > 0.01]  # straight down is a case of its own, see below
    T = MODEL.forward(q)
    index, branch, rows = MODEL.inverse(T)
    np.testing.assert_allclose(forward(rows, GEOMETRY), T[index], atol=1e-9)
    assert len(np.unique(np.column_stack([index, branch]), axis=0)) == len(index)
    every, legal = inverse(T, GEOMETRY)
    assert len(rows) == legal.sum()
    np.testing.assert_array_equal(MODEL.branches(T), every)


def test_a_hand_that_is_nearly_straight_down_gets_every_heading() -> None:
    q = np.array([[0.3, 0.8, 0.1, -300.0, -np.pi / 2 + 1e-4, 0.2]])
    index, _, rows = MODEL.inverse(MODEL.forward(q))
    assert len(index) > 6
    np.testing.assert_allclose(rows[:, 4], -np.pi / 2)
    tips = MODEL.forward(rows)[:, :3, 3]
    assert np.linalg.norm(tips - MODEL.forward(q)[0, :3, 3], axis=1).max() < 0.02


def test_the_carriage_stays_in_what_it_sweeps() -> None:
    swept = MODEL.swept["carriage's travel"]
    R, origin_mm = MODEL.link_frames(legal_q(3, 200))
    carriage = MODEL.links[0]
    centre = (R[:, 0] @ carriage.T[:3, 3]) + origin_mm[:, 0]
    assert (np.abs(centre - swept.T[:3, 3]) + carriage.half_mm <= swept.half_mm + 1e-9).all()


def test_no_point_of_the_hand_moves_farther_than_its_radii_allow() -> None:
    rng = np.random.default_rng(4)
    rows = legal_q(4, 60)
    for a, b in zip(rows[::2], rows[1::2], strict=False):
        far, beside = rng.uniform(160.0, 260.0), rng.uniform(20.0, 90.0)
        turn = rng.uniform(0, 2 * np.pi)
        ahead = np.sqrt(far**2 - beside**2) - GEOMETRY.tool_mm
        point = np.array([ahead, beside * np.cos(turn), beside * np.sin(turn), 1.0])
        path = MODEL.forward(a + np.linspace(0, 1, 300)[:, None] * (b - a)) @ point
        way_mm = np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1).sum()
        assert way_mm <= np.abs(b - a) @ MODEL.radii_mm(a, b, far, beside) + 1e-6


def test_detours_keep_both_ends_and_rise_between() -> None:
    a = np.array([0.4, 0.3, 0.1, -600.0, -0.7, 0.2])
    b = np.array([-0.8, 1.0, 0.0, -500.0, -1.2, -0.4])
    groups = list(MODEL.detours(a, b))
    assert [len(group) > 10 for group in groups] == [True, True]
    for path in (path for group in groups for path in group):
        np.testing.assert_array_equal(path[0], a)
        np.testing.assert_array_equal(path[-1], b)
        assert max(q[3] for q in path[1:-1]) >= -350.0


def test_a_retreat_goes_straight_up_from_where_the_arm_is() -> None:
    q = legal_q(5, 30)
    path = MODEL.retreats(q, 9)
    np.testing.assert_allclose(path[:, 0], q)
    tips = MODEL.forward(path)[..., :3, 3]
    np.testing.assert_allclose(tips[..., :2], np.repeat(tips[:, :1, :2], 9, axis=1), atol=1e-9)
    assert (np.diff(tips[..., 2], axis=1) >= -1e-9).all()


def test_a_link_without_a_box_is_refused() -> None:
    with pytest.raises(KeyError, match="fore"):
        UmiModel.of_boxes(GEOMETRY, {"carriage": box(0, 0, 0), "upper": box(0, 0, 0)})
