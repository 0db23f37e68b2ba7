"""Box tests of the planner against FCL and against points along the segment."""

from __future__ import annotations

import itertools

import fcl
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from controller.planning import Box
from controller.planning.geometry import lowest_z, overlap, segments_hit


def random_boxes(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(
        n, random_state=np.random.RandomState(int(rng.integers(1000)))
    ).as_matrix()
    T[:, :3, 3] = rng.uniform(-60, 60, (n, 3))
    return T, rng.uniform(2, 50, (n, 3))


def test_boxes_touch_exactly_where_fcl_says_so() -> None:
    rng = np.random.default_rng(3)
    T_a, a = random_boxes(rng, 600)
    T_b, b = random_boxes(rng, 600)
    expected = []
    for k in range(600):
        one = fcl.CollisionObject(
            fcl.Box(*(2 * a[k])), fcl.Transform(T_a[k, :3, :3], T_a[k, :3, 3])
        )
        two = fcl.CollisionObject(
            fcl.Box(*(2 * b[k])), fcl.Transform(T_b[k, :3, :3], T_b[k, :3, 3])
        )
        expected.append(bool(fcl.collide(one, two, fcl.CollisionRequest(), fcl.CollisionResult())))
    assert 100 < sum(expected) < 500
    assert overlap(T_a, a, T_b, b).tolist() == expected


def test_a_segment_hits_a_box_where_one_of_its_points_lies_inside() -> None:
    rng = np.random.default_rng(4)
    T, half = random_boxes(rng, 1)
    box = Box(T[0], half[0])
    start, end = rng.uniform(-90, 90, (400, 3)), rng.uniform(-90, 90, (400, 3))
    points = start[:, None] + np.linspace(0, 1, 4001)[None, :, None] * (end - start)[:, None]
    inside = np.all(np.abs((points - T[0, :3, 3]) @ T[0, :3, :3]) <= half[0], axis=2).any(axis=1)
    hit = segments_hit(start, end, [box])
    # a corner may be cut between two of the 4001 points, never the other way round
    assert not np.any(inside & ~hit)
    assert np.count_nonzero(hit != inside) <= 1
    assert 20 < inside.sum() < 380


def test_the_lowest_corner_is_the_lowest_of_the_eight() -> None:
    rng = np.random.default_rng(5)
    T, half = random_boxes(rng, 50)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners = np.einsum("nij,nkj->nki", T[:, :3, :3], signs * half[:, None]) + T[:, None, :3, 3]
    np.testing.assert_allclose(lowest_z(T, half), corners[..., 2].min(axis=1), atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_touching_is_mutual_and_does_not_depend_on_where_the_two_stand(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_a, a = random_boxes(rng, 40)
    T_b, b = random_boxes(rng, 40)
    here = overlap(T_a, a, T_b, b)
    assert overlap(T_b, b, T_a, a).tolist() == here.tolist()
    moved = random_boxes(rng, 1)[0]
    assert overlap(moved @ T_a, a, moved @ T_b, b).tolist() == here.tolist()
    assert overlap(T_a, a + 1.0, T_b, b)[here].all(), "a grown box touches what it touched"


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(0, 6), st.floats(0, 0.1))
def test_a_widened_box_holds_the_box_wherever_it_stands_in_its_plane(
    seed: int, by_mm: float, turned_rad: float
) -> None:
    rng = np.random.default_rng(seed)
    box = Box.from_bounds(-60, 3, 10, 24, -9, 12)
    if seed % 2:
        T = np.eye(4)
        T[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        box = box.placed(T)
    wide = box.wider_in_xz(by_mm, turned_rad)
    corners = box.half_mm * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    corners = corners @ box.T[:3, :3].T + box.T[:3, 3]
    for angle in (-turned_rad, 0.0, turned_rad):
        c, s = np.cos(angle), np.sin(angle)
        moved = corners @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
        heading = rng.uniform(0, 2 * np.pi)
        moved += by_mm * np.array([np.cos(heading), 0.0, np.sin(heading)])
        inside = (moved - wide.T[:3, 3]) @ wide.T[:3, :3]
        assert (np.abs(inside) <= wide.half_mm + 1e-9).all()
