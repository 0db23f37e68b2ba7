"""Chain code, curvature code, triangular filter, corners and size, against geometry on paper."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from controller.recognition.binary import (
    chain_code,
    chain_length_px,
    corner_table,
    curvature_code,
    find_corners,
    size_of_chains,
    triangular,
)

masks = arrays(np.bool_, st.tuples(st.integers(1, 14), st.integers(1, 14)))


def square(side_px: float, turn_rad: float, shift: tuple[float, float]) -> NDArray[np.bool_]:
    size = int(1.5 * side_px) + 30
    v, u = np.mgrid[:size, :size]
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    x, y = u - size / 2 - shift[0], v - size / 2 - shift[1]
    return np.maximum(np.abs(c * x + s * y), np.abs(c * y - s * x)) <= side_px / 2


def disc(radius_px: float, shift: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.bool_]:
    size = int(2 * radius_px) + 10
    v, u = np.mgrid[:size, :size]
    return np.hypot(u - size / 2 - shift[0], v - size / 2 - shift[1]) <= radius_px


@given(masks)
def test_the_shoelace_areas_of_all_chains_add_up_to_the_pixels(mask: NDArray[np.bool_]) -> None:
    chains = chain_code(mask)
    assert sum(chain.area_px for chain in chains) == mask.sum()
    for chain in chains:
        x, y = chain.points_px.T
        shoelace = 0.5 * float((np.roll(x, -1) * y - x * np.roll(y, -1)).sum())
        assert shoelace == chain.area_px  # y runs down: so it is positive anticlockwise to the eye


@given(masks)
def test_there_is_one_outer_chain_for_each_object_and_one_hole_for_each_hole(
    mask: NDArray[np.bool_],
) -> None:
    chains = chain_code(mask)
    objects, _ = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    padded = np.pad(~mask, 1, constant_values=True).astype(np.uint8)
    grounds, _ = cv2.connectedComponents(padded, connectivity=4)
    assert sum(not chain.is_hole for chain in chains) == objects - 1
    assert sum(chain.is_hole for chain in chains) == grounds - 2  # OpenCV's 0, and the ground


@given(masks)
def test_the_curvature_code_sums_to_a_whole_turn(mask: NDArray[np.bool_]) -> None:
    for chain in chain_code(mask):
        code = curvature_code(chain)
        assert set(code.tolist()) <= {-1, 0, 1}
        assert code.sum() == (-4 if chain.is_hole else 4)


@given(masks)
def test_a_chain_has_the_object_at_its_left_hand(mask: NDArray[np.bool_]) -> None:
    inside = np.pad(mask, 1)
    for chain in chain_code(mask):
        left = np.array([[0, -1], [-1, 0], [0, 1], [1, 0]])[chain.codes] * 0.5
        here = np.round(chain.middles_px + left).astype(int) + 1
        there = np.round(chain.middles_px - left).astype(int) + 1
        assert inside[here[:, 1], here[:, 0]].all()
        assert not inside[there[:, 1], there[:, 0]].any()


def test_one_pixel_is_four_left_turns() -> None:
    (chain,) = chain_code(np.ones((1, 1), dtype=bool))
    assert curvature_code(chain).tolist() == [1, 1, 1, 1]
    assert chain.area_px == 1


def test_nothing_has_no_chain() -> None:
    assert chain_code(np.zeros((5, 5), dtype=bool)) == ()


@given(arrays(np.int8, st.integers(1, 80), elements=st.integers(-2, 2)), st.integers(1, 30))
def test_the_filter_is_the_triangular_kernel_round_the_loop(
    code: NDArray[np.int8], length: int
) -> None:
    kernel = np.convolve(np.ones(length, int), np.ones(length, int))
    count = len(code)
    around = np.tile(code.astype(int), 2 * (length // count + 1) + 1)
    middle = (length // count + 1) * count
    expected = np.convolve(around, kernel, mode="same")[middle : middle + count]
    if len(around) < len(kernel):  # numpy then answers in the kernel's length
        return
    filtered = triangular(code, length)
    assert filtered.dtype == np.int64
    assert filtered.tolist() == expected.tolist()


@given(arrays(np.int8, st.integers(1, 60), elements=st.integers(-1, 1)), st.integers(1, 20))
def test_the_filter_of_a_boundary_followed_backwards_is_the_filter_backwards(
    code: NDArray[np.int8], length: int
) -> None:
    backwards = triangular(-code[::-1], length)
    assert backwards.tolist() == (-triangular(code, length)[::-1]).tolist()


def test_a_filter_of_no_length_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        triangular(np.zeros(4, dtype=np.int8), 0)


@pytest.mark.parametrize("side_px", [45, 90, 170])
def test_a_square_has_four_corners_however_it_is_turned(side_px: int) -> None:
    rng = np.random.default_rng(side_px)
    for degrees in range(0, 91, 3):
        (chain,) = chain_code(square(side_px, np.radians(degrees), tuple(rng.random(2))))
        corners = find_corners(triangular(curvature_code(chain), 15), 10, 15)
        assert corners.sign.tolist() == [1, 1, 1, 1], degrees
        points = chain.points_px[corners.index]
        sides = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
        assert sides == pytest.approx(side_px, abs=5.0)  # a peak is known to a few pixels


def test_a_notch_is_a_corner_of_the_other_sign() -> None:
    mask = np.zeros((120, 120), dtype=bool)
    mask[10:110, 10:110] = True
    mask[60:110, 60:110] = False
    (chain,) = chain_code(mask)
    corners = find_corners(triangular(curvature_code(chain), 15), 10, 15)
    assert sorted(corners.sign.tolist()) == [-1, 1, 1, 1, 1, 1]
    assert corners.size.tolist() == [15] * 6  # a right angle far from others is the filter's height


def test_a_disc_has_no_corners() -> None:
    (chain,) = chain_code(disc(80))
    assert len(find_corners(triangular(curvature_code(chain), 15), 10, 15).size) == 0


@given(st.integers(0, 400))
def test_corners_do_not_depend_on_where_the_boundary_begins(begin: int) -> None:
    (chain,) = chain_code(square(70, 0.4, (0.2, 0.7)))
    filtered = triangular(curvature_code(chain), 15)
    count = len(filtered)
    corners = find_corners(filtered, 10, 15)
    rolled = find_corners(np.roll(filtered, -begin), 10, 15)
    where = np.sort((rolled.distance_px + begin) % count)
    assert where.tolist() == np.sort(corners.distance_px % count).tolist()


def test_the_middle_of_a_plateau_is_its_corner() -> None:
    filtered = np.zeros(60, dtype=np.int64)
    filtered[20:25] = 12
    assert find_corners(filtered, 10, 15).distance_px.tolist() == [22.0]
    assert find_corners(np.roll(filtered, -22), 10, 15).distance_px.tolist() == [0.0]


def test_the_table_is_the_papers() -> None:
    filtered = np.zeros(100, dtype=np.int64)
    filtered[[1, 50]] = 18, -17
    lines = corner_table(find_corners(filtered, 10, 15)).splitlines()
    assert [line.split() for line in lines] == [
        ["Corner", "No.", "Distance", "Size"],
        ["1", "1", "18"],
        ["2", "50", "-17"],
    ]


@pytest.mark.parametrize("radius_px", [20, 50, 120])
def test_the_length_of_a_square_is_without_bias_over_its_turns(radius_px: int) -> None:
    rng = np.random.default_rng(radius_px)
    found = [
        chain_length_px(chain_code(square(2 * radius_px, turn, tuple(rng.random(2))))[0])
        for turn in np.radians(np.arange(0, 90, 3))
    ]
    assert np.mean(found) == pytest.approx(8 * radius_px, rel=0.005)
    assert found == pytest.approx([8 * radius_px] * len(found), rel=0.035)


@pytest.mark.parametrize("radius_px", [20, 50, 120, 200])
def test_the_length_of_a_circle_is_without_bias(radius_px: int) -> None:
    rng = np.random.default_rng(radius_px)
    found = [
        chain_length_px(chain_code(disc(radius_px, tuple(rng.random(2))))[0]) for _ in range(8)
    ]
    assert np.mean(found) == pytest.approx(2 * np.pi * radius_px, rel=0.005)


def test_the_size_of_a_plate_with_two_holes_is_counted() -> None:
    mask = np.zeros((200, 300), dtype=bool)
    mask[20:180, 20:280] = True
    mask[50:70, 50:90] = False
    mask[100:110, 100:110] = False
    size = size_of_chains(chain_code(mask), 0.5)
    assert size.area_mm2 == (160 * 260 - 20 * 40 - 100) * 0.25
    assert size.hole_count == 2
    assert size.hole_area_mm2.tolist() == [200.0, 25.0]
    assert size.perimeter_mm == pytest.approx(420.0, rel=0.03)


def test_a_size_needs_an_outer_chain() -> None:
    with pytest.raises(ValueError, match="no outer chain"):
        size_of_chains((), 0.25)


@settings(max_examples=20)
@given(st.integers(0, 3), st.integers(0, 20), st.integers(0, 20))
def test_a_moved_or_quarter_turned_mask_has_the_same_turns(turns: int, dx: int, dy: int) -> None:
    rng = np.random.default_rng(3)
    mask = cv2.GaussianBlur(rng.random((40, 40)), (0, 0), 3.0) > 0.5
    moved = np.zeros((80, 80), dtype=bool)
    moved[dy : dy + 40, dx : dx + 40] = np.rot90(mask, turns)

    def words(pixels: NDArray[np.bool_]) -> list[tuple[int, ...]]:
        out = []
        for chain in chain_code(pixels):
            code = curvature_code(chain).tolist()
            out.append(min(tuple(code[i:] + code[:i]) for i in range(len(code))))
        return sorted(out)

    assert words(moved) == words(mask)
