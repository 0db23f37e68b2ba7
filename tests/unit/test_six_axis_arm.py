"""Kinematics of the second arm against a chain of its own, and there and back on all branches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from controller.cli.project.starter.drivers.arm.model import HIGH_RAD, LOW_RAD, SixAxis

ARM = SixAxis()


def turned(axis: str, angle_rad: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(axis, angle_rad).as_matrix()
    return T


def shifted(x: float, z: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[[0, 2], 3] = x, z
    return T


def chain(q: np.ndarray) -> dict[str, np.ndarray]:
    """Return the frames (4, 4) along the arm at (6,), one joint after the other."""
    turret = shifted(0.0, 430.0) @ turned("z", q[0])
    upper = turret @ shifted(60.0) @ turned("y", -q[1])
    fore = upper @ shifted(420.0) @ turned("y", -q[2])
    wrist = fore @ shifted(390.0) @ turned("x", q[3]) @ turned("y", q[4])
    tip = wrist @ turned("x", q[5]) @ shifted(177.0)
    return {"turret": turret, "upper": upper, "fore": fore, "wrist": wrist, "tip": tip}


def random_q(seed: int, count: int) -> np.ndarray:
    return LOW_RAD + np.random.default_rng(seed).random((count, 6)) * (HIGH_RAD - LOW_RAD)


def test_tip_and_links_are_where_the_chain_of_joints_has_them() -> None:
    q = random_q(1, 200)
    R, origin_mm = ARM.link_frames(q)
    tips = ARM.forward(q)
    for row, joints in enumerate(q):
        expected = chain(joints)
        np.testing.assert_allclose(tips[row], expected["tip"], atol=1e-9)
        for k, link in enumerate(ARM.links):
            np.testing.assert_allclose(R[row, k], expected[link.name][:3, :3], atol=1e-12)
            np.testing.assert_allclose(origin_mm[row, k], expected[link.name][:3, 3], atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_every_branch_leads_back_to_its_pose(seed: int) -> None:
    T = ARM.forward(random_q(seed, 20))
    q = ARM.branches(T)
    assert q.shape == (20, 8, 6)
    there = np.isfinite(q).all(axis=2)
    assert there.any(axis=1).all()
    back = ARM.forward(q[there])
    np.testing.assert_allclose(back, np.repeat(T[:, None], 8, axis=1)[there], atol=1e-7)


def test_a_pose_well_within_reach_has_eight_different_branches() -> None:
    T = chain(np.radians([20.0, 60.0, -70.0, 40.0, 50.0, -30.0]))["tip"]
    (q,) = ARM.branches(T[None])
    assert np.isfinite(q).all()
    for a in range(8):
        np.testing.assert_allclose(chain(q[a])["tip"], T, atol=1e-8)
        for b in range(a):
            assert np.abs(np.angle(np.exp(1j * (q[a] - q[b])))).max() > 0.1


def test_the_inverse_finds_the_joints_that_made_the_pose() -> None:
    q = random_q(2, 500)
    q = q[np.abs(np.sin(q[:, 4])) > 1e-3]
    index, branch, rows = ARM.inverse(ARM.forward(q))
    assert ARM.within_limits(rows).all()
    assert set(branch.tolist()) == set(range(8))
    off = np.abs(rows - q[index]).max(axis=1)
    nearest = np.full(len(q), np.inf)
    np.minimum.at(nearest, index, off)
    assert nearest.max() < 1e-6


def test_with_a_straight_wrist_all_of_the_turn_is_the_flanges() -> None:
    T = chain(np.radians([10.0, 50.0, -80.0, 35.0, 0.0, 25.0]))["tip"]
    _, _, rows = ARM.inverse(T[None])
    straight = rows[np.abs(rows[:, 4]) < 1e-8]
    assert len(straight) > 0
    np.testing.assert_allclose(np.degrees(straight[:, 5]), 60.0, atol=1e-6)
    for q in rows:
        np.testing.assert_allclose(chain(q)["tip"], T, atol=1e-6)


def test_a_straight_line_keeps_its_branch_without_a_jump() -> None:
    start = chain(np.radians([20.0, 60.0, -90.0, 40.0, 70.0, -30.0]))["tip"]
    T = np.repeat(start[None], 41, axis=0)
    T[:, 2, 3] += np.linspace(0.0, 80.0, 41)
    index, branch, q = ARM.inverse(T)
    whole = [b for b in range(8) if (branch == b).sum() == 41]
    assert len(whole) >= 2
    for b in whole:
        assert (np.diff(index[branch == b]) == 1).all()
        assert np.abs(np.diff(q[branch == b], axis=0)).max() < 0.05


@pytest.mark.parametrize("joint", range(6))
def test_no_point_moves_farther_than_the_radii_allow(joint: int) -> None:
    rng = np.random.default_rng(joint)
    for q in random_q(joint, 30):
        to = q.copy()
        to[joint] = rng.uniform(LOW_RAD[joint], HIGH_RAD[joint])
        far, beside = 260.0, 70.0
        turn = rng.uniform(0, 2 * np.pi)
        ahead = np.sqrt(far**2 - beside**2) - ARM.tool_mm
        point = np.array([ahead, beside * np.cos(turn), beside * np.sin(turn), 1.0])
        path = ARM.forward(q + np.linspace(0, 1, 300)[:, None] * (to - q)) @ point
        way_mm = np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1).sum()
        assert way_mm <= np.abs(to - q) @ ARM.radii_mm(q, to, far, beside) + 1e-6


def test_what_is_passed_is_named() -> None:
    q = np.radians([0.0, 60.0, -70.0, 0.0, 131.0, 0.0])
    assert ARM.limit_report(q) == "bend passed by 11.0 deg"
    assert not ARM.within_limits(q)
    assert ARM.limit_report(np.radians([0.0, 60.0, -70.0, 0.0, 30.0, 0.0])) == "within limits"
