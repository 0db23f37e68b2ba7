"""Corners of outlines known on paper."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from shapely import Polygon, get_coordinates

from controller.recognition.binary import (
    CornerTolerances,
    NoOutlineError,
    find_peaks,
    outline_corners,
    triangular,
)

Array = NDArray[np.float64]
# A corner is the sample nearest to it, half a spacing off, and smoothed by its neighbours.
NEAR_MM = 1.5 * CornerTolerances().spacing_mm
ELL = np.array([[0, 0], [60, 0], [60, 20], [25, 20], [25, 45], [0, 45]], dtype=float)


def dense(corners: Array, step_mm: float = 0.25) -> Array:
    """Points along a polygon as close together as pixels are."""
    out = []
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(1, round(float(np.linalg.norm(q - p)) / step_mm))
        out.append(p + (q - p) * (np.arange(count) / count)[:, None])
    return np.concatenate(out)


def turned(points: Array, turn_rad: float, shift: tuple[float, float] = (0.0, 0.0)) -> Array:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return points @ np.array([[c, s], [-s, c]]) + shift


def noisy(points: Array, seed: int, sigma_mm: float = 0.03) -> Array:
    return points + np.random.default_rng(seed).normal(0, sigma_mm, points.shape)


def circle(radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> Array:
    angle = np.linspace(0, 2 * np.pi, max(24, round(8 * np.pi * radius)), endpoint=False)
    return np.array(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def slot(length: float, radius: float) -> Array:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 60)
    cap = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    middle = np.array([length / 2, 0.0])
    return np.concatenate([cap + middle, -cap - middle])


def rasterised(loops: list[Array], mm_per_px: float = 0.25) -> tuple[list[Array], list[bool]]:
    """Loops as a camera gives them: filled into pixels, blurred, cut at half level (in mm)."""
    low = np.min([p.min(axis=0) for p in loops], axis=0) - 5
    size = np.ceil((np.max([p.max(axis=0) for p in loops], axis=0) - low + 5) / mm_per_px)
    finer = 8  # OpenCV fills the pixels of the rim too, half a pixel too far all round
    fine = np.zeros((finer * int(size[1]), finer * int(size[0])), dtype=np.uint8)
    fixed = [
        np.round((((p - low) / mm_per_px + 0.5) * finer - 0.5) * 16).astype(np.int32) for p in loops
    ]
    cv2.fillPoly(fine, fixed, 255, cv2.LINE_8, 4)
    image = cv2.resize(fine, None, fx=1 / finer, fy=1 / finer, interpolation=cv2.INTER_AREA)
    level = cv2.GaussianBlur(image, (0, 0), 0.8).astype(float) - 127.5
    found, tree = cv2.findContours(
        (level > 0).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    gx, gy = (cv2.Sobel(level, cv2.CV_64F, *d, ksize=3) / 8 for d in ((1, 0), (0, 1)))
    out = []
    for contour in found:
        u, v = contour[:, 0].T
        g2 = gx[v, u] ** 2 + gy[v, u] ** 2
        step = np.clip(level[v, u] / np.maximum(g2, 1e-9), -0.02, 0.02)
        # Newton's step to the half level, a pixel at most
        on_it = np.column_stack([u - step * gx[v, u], v - step * gy[v, u]])
        out.append(low + on_it * mm_per_px)
    return out, [int(row[3]) >= 0 for row in tree[0]]


@given(st.floats(-3.1, 3.1), st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_polygon_has_its_corners_however_it_lies(turn: float, seed: int) -> None:
    lying = turned(ELL, turn, (70.0, -30.0))
    for points in (dense(lying), dense(lying)[::-1]):  # and whichever way it runs
        found = outline_corners(noisy(points, seed))
        apart = np.linalg.norm(found.at_mm[:, None] - lying[None], axis=2)
        assert apart.min(axis=0) == pytest.approx(np.zeros(6), abs=NEAR_MM)
        assert np.sort(np.degrees(found.turn_rad)) == pytest.approx([-90, *[90] * 5], abs=15.0)


def test_round_outlines_have_no_corners() -> None:
    box = Polygon([(0, 0), (80, 0), (80, 50), (0, 50)]).buffer(-9).buffer(9, 64)
    rounded = dense(get_coordinates(box.exterior)[:-1])
    for points in (circle(30), circle(8, (10, 0)), dense(slot(40, 10)), rounded):
        assert len(outline_corners(noisy(points, 5)).at_mm) == 0


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_random_polygons_have_their_own_corners(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 9))
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False) + rng.uniform(-0.2, 0.2, count)
    corners = np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(25, 45, (count, 1))
    side = np.roll(corners, -1, axis=0) - corners
    bend = np.angle(np.exp(1j * np.diff(np.unwrap(np.arctan2(*side.T[::-1])), append=np.nan)))
    first = np.arctan2(*side[0][::-1]) - np.arctan2(*side[-1][::-1])
    bend = np.abs(np.angle(np.exp(1j * np.append(bend[:-1], first))))
    bend = np.roll(bend, 1)  # of the corner each side begins at
    found = outline_corners(noisy(dense(corners), seed))
    apart = np.linalg.norm(found.at_mm[:, None] - corners[None], axis=2)
    assert (apart.min(axis=1) < 0.6).all()  # no corner is invented
    clear = bend > np.radians(30)
    assert (apart.min(axis=0)[clear] < 0.6).all()  # and none that is one is lost


def test_blurred_pixels_have_the_corners_of_the_shape() -> None:
    lying = turned(ELL, 0.7)
    (outline, *_), (is_hole, *_) = rasterised([lying])
    assert not is_hole
    found = outline_corners(outline)
    apart = np.linalg.norm(found.at_mm[:, None] - lying[None], axis=2).min(axis=0)
    assert len(found.at_mm) == 6
    assert apart.max() < NEAR_MM


def test_what_encloses_nothing_has_no_corners() -> None:
    with pytest.raises(NoOutlineError, match="at least 3"):
        outline_corners(np.zeros((2, 2)))
    there = np.column_stack([np.arange(40.0), np.zeros(40)])
    with pytest.raises(NoOutlineError, match="encloses nothing"):
        outline_corners(np.concatenate([there, there[::-1]]))


def test_finer_pixels_than_a_quarter_mm_change_no_tolerance() -> None:
    assert CornerTolerances.for_pixels(0.05) == CornerTolerances()
    assert CornerTolerances.for_pixels(0.5).chord_mm == pytest.approx(2.0)
    assert CornerTolerances.for_pixels(1.0).chord_mm == pytest.approx(4.0)


# --- the filter ----------------------------------------------------------------------------------


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
    assert triangular(code, length).tolist() == expected.tolist()


def test_a_filter_of_no_length_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        triangular(np.zeros(4, dtype=np.int8), 0)


def test_the_middle_of_a_plateau_is_its_corner_wherever_the_loop_begins() -> None:
    filtered = np.zeros(60)
    filtered[20:25] = 12
    assert find_peaks(filtered, 10, 15).tolist() == [22]
    assert find_peaks(np.roll(filtered, -22), 10, 15).tolist() == [0]
