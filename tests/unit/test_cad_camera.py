"""The camera model: there and back, against OpenCV, and against a projection done by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.imaging import Camera, inverse_pose, transform

Array = NDArray[np.float64]
SIZE = (1280, 1024)


def pose(rotation: Array, position: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(np.asarray(rotation, float).reshape(3, 1))[0], position
    return T


def camera(
    distortion: Array | None = None, T: Array | None = None, focal_px: float = 3500.0
) -> Camera:
    K = np.array([[focal_px, 0, 639.5], [0, focal_px * 1.001, 511.5], [0, 0, 1.0]])
    return Camera(
        SIZE,
        K,
        np.zeros(5) if distortion is None else distortion,
        # straight down from 900 mm: picture x along world x, picture y along -y
        pose(np.array([np.pi, 0, 0]), np.array([0, 0, 900.0])) if T is None else T,
    )


rotations = st.tuples(*[st.floats(-1.2, 1.2)] * 3).map(np.array)
positions = st.tuples(*[st.floats(-500, 500)] * 3).map(np.array)
lenses = st.tuples(
    st.floats(-0.12, 0.12),
    st.floats(-0.12, 0.12),
    st.floats(-1e-3, 1e-3),
    st.floats(-1e-3, 1e-3),
    st.floats(-0.1, 0.1),
).map(np.array)
pixels = st.tuples(st.floats(-0.5, 1279.5), st.floats(-0.5, 1023.5))


@settings(max_examples=150, deadline=None)
@given(
    st.lists(pixels, min_size=1, max_size=8),
    rotations,
    positions,
    lenses,
    st.floats(1500, 6000),
    st.floats(100, 3000),
)
def test_a_pixel_seen_along_its_sight_line_is_that_pixel(
    spots: list[tuple[float, float]],
    rotation: Array,
    position: Array,
    lens: Array,
    focal_px: float,
    depth_mm: float,
) -> None:
    cam = camera(lens, pose(rotation, position), focal_px)
    asked = np.array(spots)
    points = cam.position_mm + depth_mm * cam.sight_lines(asked)
    assert np.abs(cam.project(points) - asked).max() < 1e-3
    # scaled to depth 1: that far along the camera's axis they are
    assert transform(inverse_pose(cam.T_world_cam), points)[:, 2] == pytest.approx(depth_mm)


@settings(max_examples=100, deadline=None)
@given(rotations, positions, st.lists(pixels, min_size=1, max_size=8), st.floats(100, 3000))
def test_without_distortion_projection_is_the_pin_hole_on_paper(
    rotation: Array, position: Array, spots: list[tuple[float, float]], depth_mm: float
) -> None:
    cam = camera(None, pose(rotation, position))
    local = np.column_stack(
        [
            (np.array(spots)[:, 0] - 639.5) / 3500.0,
            (np.array(spots)[:, 1] - 511.5) / 3503.5,
            np.ones(len(spots)),
        ]
    )
    world = transform(cam.T_world_cam, depth_mm * local)
    assert cam.project(world) == pytest.approx(np.array(spots), abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(lenses, st.floats(-100, 100), st.floats(-80, 80))
def test_distortion_is_the_formula_of_opencvs_manual(lens: Array, x_mm: float, y_mm: float) -> None:
    cam = camera(lens, np.eye(4))
    k1, k2, p1, p2, k3 = lens
    x, y = x_mm / 800, y_mm / 800
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    got = cam.project(np.array([[x_mm, y_mm, 800.0]]))[0]
    assert got == pytest.approx([3500 * u + 639.5, 3503.5 * v + 511.5], abs=1e-6)


def test_opencv_projects_the_same_pixels() -> None:
    rng = np.random.default_rng(1)
    lens = np.array([-0.08, 0.11, 2e-4, -1e-4, 0.02])
    cam = camera(lens, pose(np.array([2.9, 0.1, -0.2]), np.array([10.0, -20.0, 900.0])))
    points = rng.uniform([-100, -80, 0], [100, 80, 60], (50, 3))
    T = np.linalg.inv(cam.T_world_cam)
    theirs, _ = cv2.projectPoints(points, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], cam.K, lens)
    assert cam.project(points) == pytest.approx(theirs.reshape(-1, 2), abs=1e-9)


@pytest.mark.parametrize("off_rad", [0.0, 1e-9, 3e-6, 9e-6, 2e-5])
@pytest.mark.parametrize("around", [0.0, np.pi])
def test_a_turn_too_small_for_rotation_vectors_is_not_rounded_away(
    around: float, off_rad: float
) -> None:
    c, s = np.cos(around + off_rad), np.sin(around + off_rad)
    T = np.eye(4)
    T[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]]
    T[2, 3] = 900.0 if around else -900.0
    cam = camera(None, T)
    local = np.array([[80.0, 60.0, 900.0]])
    seen = cam.project(transform(T, local))[0]
    assert seen == pytest.approx([639.5 + 3500 * 80 / 900, 511.5 + 3503.5 * 60 / 900], abs=1e-7)


def test_nothing_projects_to_no_pixels() -> None:
    assert camera().project(np.empty((0, 3))).shape == (0, 2)


def test_the_table_of_sight_lines_holds_those_of_every_pixel() -> None:
    cam = camera(np.array([-0.06, 0.04, 4e-4, -3e-4, 0.0]))
    table = cam.sight_line_table
    assert table.shape == (1024, 1280, 3)
    spots = np.array([[0, 0], [1279, 0], [0, 1023], [1279, 1023], [640, 512], [17, 900]])
    expected = cam.sight_lines(spots.astype(float))
    # single precision: 1e-7 of a metre's reach is 1e-4 mm
    assert table[spots[:, 1], spots[:, 0]] == pytest.approx(expected, abs=2e-7)


def test_a_camera_straight_above_sees_right_as_x_and_up_as_y() -> None:
    cam = camera()
    middle, right, up = cam.project(np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0.0]]))
    assert middle == pytest.approx([639.5, 511.5])
    assert right == pytest.approx([639.5 + 3500 * 10 / 900, 511.5])
    assert up == pytest.approx([639.5, 511.5 - 3503.5 * 10 / 900])


@pytest.mark.parametrize("height_mm", [0.0, 25.0, -3.0])
def test_sight_lines_meet_a_plane_where_its_points_are(height_mm: float) -> None:
    lens = np.array([-0.08, 0.11, 2e-4, -1e-4, 0.0])
    cam = camera(lens, pose(np.array([3.0, 0.1, 0.3]), np.array([10.0, -20.0, 900.0])))
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-90, 90, (20, 2)), np.full(20, height_mm)])
    assert cam.on_plane(cam.project(points), height_mm) == pytest.approx(points, abs=1e-4)


def test_a_pixel_is_as_large_as_its_depth_says() -> None:
    cam = camera()
    assert cam.mm_per_px(np.array([50.0, 20.0, 0.0])) == pytest.approx(900 / 3500)
    assert cam.mm_per_px(np.array([0.0, 0.0, 200.0])) == pytest.approx(700 / 3500)


@given(rotations, positions)
def test_a_pose_times_its_inverse_is_nothing(rotation: Array, position: Array) -> None:
    T = pose(rotation, position)
    assert inverse_pose(T) @ T == pytest.approx(np.eye(4), abs=1e-9)
    points = np.array([[1.0, 2, 3], [-40, 5, 60]])
    assert transform(inverse_pose(T), transform(T, points)) == pytest.approx(points, abs=1e-9)
