import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from emulators.ur_arm import (
    MODELS,
    UR5E,
    UrFacts,
    flange_pose,
    inverse,
    link_poses,
    pose_of,
    pose_vector,
)

EVERY_MODEL = pytest.mark.parametrize("facts", MODELS.values(), ids=MODELS)


@EVERY_MODEL
def test_with_all_joints_at_zero_the_arm_lies_along_minus_x(facts: UrFacts) -> None:
    x, y, z = flange_pose(facts, (0.0,) * 6)[:3, 3]
    assert_allclose(x, facts.a2_mm + facts.a3_mm)
    assert_allclose(y, -(facts.d4_mm + facts.d6_mm))
    assert_allclose(z, facts.d1_mm - facts.d5_mm)


def test_an_upright_ur5e_has_its_wrist_above_the_base() -> None:
    q = (0.0, -math.pi / 2, 0.0, -math.pi / 2, 0.0, 0.0)
    shoulder, elbow, wrist1 = (T[:3, 3] for T in link_poses(UR5E, q)[:3])
    assert_allclose(shoulder, (0, 0, 162.5), atol=1e-9)
    assert_allclose(elbow, (0, 0, 162.5 + 425), atol=1e-9)
    assert_allclose(wrist1, (0, 0, 162.5 + 425 + 392.2), atol=1e-9)


@EVERY_MODEL
def test_every_branch_of_the_inverse_reaches_the_pose_and_the_joints_are_among_them(
    facts: UrFacts,
) -> None:
    rng = np.random.default_rng(4)
    counts = set()
    for _ in range(100):
        q = rng.uniform(-3.0, 3.0, 6)
        T = flange_pose(facts, q)
        found = inverse(facts, T, q)
        assert_allclose(found[0], q, atol=1e-6)
        for one in found:
            assert_allclose(flange_pose(facts, one), T, atol=1e-6)
        counts.add(len(found))
    assert max(counts) == 8


def test_a_pose_too_far_away_has_no_joints() -> None:
    T = flange_pose(UR5E, (0.1, -1.0, 1.0, 0.2, 1.0, 0.3))
    T = T @ pose_of((2.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert inverse(UR5E, T, (0.0,) * 6) == []


def test_the_nearest_turn_of_a_joint_is_taken() -> None:
    q = (0.2, -1.2, 1.4, -1.0, -1.5, 5.0)
    found = inverse(UR5E, flange_pose(UR5E, q), q)
    assert_allclose(found[0], q, atol=1e-6)


def test_with_the_wrist_straight_wrist_3_stays_where_it_is() -> None:
    q = (0.2, -1.2, 1.4, -1.0, 0.0, 0.7)
    found = inverse(UR5E, flange_pose(UR5E, q), q)
    assert_allclose(found[0], q, atol=1e-6)


@pytest.mark.parametrize(
    "vector",
    [
        (0.1, -0.2, 0.3, 0.0, 0.0, 0.0),
        (0.1, -0.2, 0.3, 1e-10, 0.0, 0.0),
        (0.4, 0.2, 0.3, 0.0, math.pi / 2, 0.0),
        (0.4, 0.2, 0.3, 1.2, -2.2, 0.1),
        (0.4, 0.2, 0.3, math.pi, 0.0, 0.0),
    ],
)
def test_a_pose_vector_and_its_pose_are_the_same(vector: tuple[float, ...]) -> None:
    assert_allclose(pose_vector(pose_of(vector)), vector, atol=1e-9)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    T = pose_of((0.0, 0.0, 0.0, 0.0, 0.0, math.pi / 2))
    assert_allclose(T[:3, :3] @ (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), atol=1e-12)
