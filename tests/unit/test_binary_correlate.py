"""Correlation of boundary strings: the right model is found, and how it is turned."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from data_files import part_file
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import Polygon, get_coordinates
from test_binary_strings import ELL, circle, dense, noisy, rasterised, slot, turned

from controller.cad import load_solid, outline, prepare_views
from controller.recognition.binary import (
    BinaryTolerances,
    BoundaryString,
    StringMatch,
    boundary_string,
    correlate,
    model_string,
)

Array = NDArray[np.float64]
SHIFT = (40.0, -25.0)


def string(corners: Array, *holes: Array) -> BoundaryString:
    return boundary_string([dense(corners), *holes], [False] + [True] * len(holes))


def moved_string(seed: int, turn: float, corners: Array, *holes: Array) -> BoundaryString:
    loops = [noisy(turned(p, turn, SHIFT), seed) for p in (dense(corners), *holes)]
    return boundary_string(loops, [False] + [True] * len(holes))


def degrees_off(found: float, turn: float) -> float:
    return abs(float(np.degrees(np.angle(np.exp(1j * (found - turn))))))


def best(observed: BoundaryString, *models: BoundaryString) -> StringMatch:
    return correlate(observed, models)[0]


def random_polygon(rng: np.random.Generator, count: int) -> Array:
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    angle += rng.uniform(-0.4, 0.4, count) * 2 * np.pi / count
    radius = rng.uniform(20, 45, (count, 1))
    return np.column_stack([np.cos(angle), np.sin(angle)]) * radius


@given(st.floats(-3.1, 3.1), st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_an_angle_piece_is_found_however_it_lies(turn: float, seed: int) -> None:
    match = best(moved_string(seed, turn, ELL), string(ELL))
    assert degrees_off(match.turn_rad, turn) < 0.3
    assert match.shift_mm == pytest.approx(SHIFT, abs=0.1)
    assert (match.matched_count, match.missed_count, match.spurious_count) == (6, 0, 0)
    assert match.error_mm < 0.1


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_the_right_one_of_ten_random_polygons_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = [random_polygon(rng, int(rng.integers(4, 9))) for _ in range(10)]
    turn = float(rng.uniform(-np.pi, np.pi))
    matches = correlate(moved_string(seed, turn, shapes[3]), [string(shape) for shape in shapes])
    assert matches[0].model_index == 3
    assert degrees_off(matches[0].turn_rad, turn) < 1.0


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_polygons_with_rounded_corners_are_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sharp = [random_polygon(rng, int(rng.integers(4, 7))) for _ in range(5)]
    shapes = [
        get_coordinates(Polygon(p).buffer(-4).buffer(8, 32).buffer(-4, 32).exterior)[:-1]
        for p in sharp
    ]
    turn = float(rng.uniform(-np.pi, np.pi))
    match = best(moved_string(seed, turn, shapes[2]), *(string(shape) for shape in shapes))
    assert match.model_index == 2
    assert degrees_off(match.turn_rad, turn) < 1.0


def test_a_chip_adds_spurious_corners_and_a_blunt_corner_misses_one() -> None:
    chip = [[30, 0], [31, 2.5], [34, 2.5], [35, 0]]
    blunt = [[6, 45], [4.5, 44.7], [3, 44.1], [1.5, 43.0], [0.6, 41.6], [0.1, 40.0]]
    chipped = np.array([ELL[0].tolist(), *chip, *ELL[1:5].tolist(), *blunt])
    match = best(moved_string(1, 1.1, chipped), string(ELL), string(slot(40, 10)))
    assert match.model_index == 0
    assert degrees_off(match.turn_rad, 1.1) < 1.0
    assert match.matched_count >= 5
    assert match.spurious_count >= 2


def test_two_equal_ends_are_both_named() -> None:
    plate = np.array([[0, 0], [60, 0], [60, 30], [0, 30]], dtype=float)
    matches = correlate(moved_string(2, 0.4, plate), [string(plate)])
    turns = [match.turn_rad for match in matches if match.error_mm < 0.1]
    assert len(turns) == 2
    assert sorted(degrees_off(turn, 0.4) for turn in turns) == pytest.approx([0, 180], abs=0.5)


def test_a_hole_decides_between_equal_ends() -> None:
    plate = np.array([[0, 0], [60, 0], [60, 30], [0, 30]], dtype=float)
    hole = circle(5, (15, 15))
    match = best(moved_string(3, -2.0, plate, hole), string(plate, hole))
    assert degrees_off(match.turn_rad, -2.0) < 0.3
    assert match.matched_count == 5


@pytest.mark.parametrize("turn", [-2.5, -0.3, 0.9, 3.0])
def test_a_disc_is_turned_by_its_holes(turn: float) -> None:
    holes = [circle(5, (18, 0)), circle(5, (0, 18)), circle(3, (-10, -14))]
    other = [circle(5, (18, 0)), circle(5, (0, -18)), circle(3, (-10, 14))]  # its mirror image
    match = best(
        moved_string(4, turn, circle(30), *holes),
        string(circle(30), *other),
        string(circle(30), *holes),
    )
    assert match.model_index == 1
    assert not match.turn_is_free
    assert degrees_off(match.turn_rad, turn) < 0.5
    assert match.matched_count == 3


def test_a_plain_disc_is_found_and_its_turn_is_free() -> None:
    ring = string(circle(30), circle(10))
    match = best(moved_string(5, 1.0, circle(30), circle(10)), string(ELL), ring)
    assert match.model_index == 1
    assert match.turn_is_free
    assert match.shift_mm == pytest.approx(SHIFT, abs=0.1)


def test_a_smooth_cam_without_corners_is_turned_by_its_outline() -> None:
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    radius = (30 + 5 * np.cos(angle) + 2 * np.sin(2 * angle))[:, None]
    cam = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    mirrored = cam * (1, -1)
    match = best(moved_string(6, 2.2, cam), string(mirrored), string(cam))
    assert match.model_index == 1
    assert not match.turn_is_free
    assert degrees_off(match.turn_rad, 2.2) < 0.5


def test_the_turn_of_a_correlation_reversed_is_reversed() -> None:
    a, b = moved_string(7, 0.8, ELL), string(ELL)
    there, back = best(a, b), best(b, a)
    assert degrees_off(there.turn_rad, -back.turn_rad) < 0.3


def test_a_slightly_larger_view_still_is_the_same() -> None:
    match = best(moved_string(8, 0.8, ELL * 1.02), string(ELL), string(slot(60, 20)))
    assert match.model_index == 0
    assert degrees_off(match.turn_rad, 0.8) < 0.5


def test_shapes_of_another_size_are_no_match() -> None:
    assert correlate(string(ELL), [string(ELL * 2), string(ELL * 0.5)]) == ()


@pytest.fixture(scope="module")
def part_views() -> list[tuple[BoundaryString, list[Array], list[bool]]]:
    views = []
    for name in ("angle_block", "holder", "idler_riser", "flange_xy"):
        solid = load_solid(part_file(f"{name}.stl"), unit="mm")
        view = outline(solid, np.eye(3), prepared=prepare_views(solid))
        loops = [loop.points for loop in view.loops]
        views.append((model_string(view.loops), loops, [loop.is_hole for loop in view.loops]))
    return views


@pytest.mark.parametrize("part", range(4))
def test_a_parts_rasterised_silhouette_is_recognised(
    part: int, part_views: list[tuple[BoundaryString, list[Array], list[bool]]]
) -> None:
    cv2.setNumThreads(1)
    models = [view[0] for view in part_views]
    for turn in (-2.4, 0.3, 1.9):
        loops = [turned(p, turn, SHIFT) for p in part_views[part][1]]
        observed = boundary_string(*rasterised(loops))
        matches = correlate(observed, models)
        assert matches[0].model_index == part
        # symmetric outlines have several turns; a right one is among those as good as the best
        alike = [m for m in matches if m.model_index == part and m.error_mm < 0.15]
        assert min(degrees_off(match.turn_rad, turn) for match in alike) < 1.0


@pytest.mark.parametrize("mm_per_px", [0.5, 1.0])
def test_coarser_pixels_are_recognised_with_tolerances_of_their_own(mm_per_px: float) -> None:
    limits = BinaryTolerances.for_pixels(mm_per_px)
    hole = circle(6, (12, 30))
    shapes = [(ELL, hole), (ELL * (1, -1), hole * (1, -1)), (ELL * (0.8, 1.2), hole)]
    models = [
        boundary_string([dense(corners), bore], [False, True], limits) for corners, bore in shapes
    ]
    for turn in (-1.0, 0.5, 2.8):
        lying = [turned(p, turn, SHIFT) for p in (ELL, hole)]
        match = correlate(boundary_string(*rasterised(lying, mm_per_px), limits), models, limits)[0]
        assert match.model_index == 0
        assert degrees_off(match.turn_rad, turn) < 1.0
        assert match.shift_mm == pytest.approx(SHIFT, abs=0.3 * mm_per_px)


def test_finer_pixels_than_a_quarter_mm_change_no_tolerance() -> None:
    assert BinaryTolerances.for_pixels(0.1) == BinaryTolerances()
