"""Boundary strings: lines, arcs and corners of outlines known on paper."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import Polygon, get_coordinates

from controller.cad import Loop, Stroke
from controller.recognition.binary import (
    BoundaryString,
    NoOutlineError,
    boundary_string,
    model_string,
    size_of_string,
)

Array = NDArray[np.float64]
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


def only(points: Array) -> BoundaryString:
    return boundary_string([points], [False])


@given(st.floats(-3.1, 3.1), st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_a_polygon_is_its_sides_and_corners_however_it_lies(turn: float, seed: int) -> None:
    lying = turned(ELL, turn, (70.0, -30.0))
    string = only(noisy(dense(lying), seed))
    assert not string.is_arc.any()
    assert len(string.corner_mm) == 6
    apart = np.linalg.norm(string.corner_mm[:, None] - lying[None], axis=2)
    assert apart.min(axis=0) == pytest.approx(np.zeros(6), abs=0.1)
    sides = np.roll(np.linalg.norm(lying - np.roll(lying, -1, axis=0), axis=1), -apart[0].argmin())
    assert string.length_mm == pytest.approx(sides, abs=1.6)  # trimmed by 0.5 mm at both ends
    assert np.sort(np.degrees(string.joint_rad)) == pytest.approx([-90, *[90] * 5], abs=1.0)
    assert string.area_mm2 == pytest.approx(60 * 20 + 25 * 25, rel=2e-3)
    assert string.perimeter_mm == pytest.approx(210, rel=6e-3)


def test_a_slot_is_two_lines_and_two_half_circles() -> None:
    for start in (0, 37, 120):
        string = only(noisy(np.roll(dense(slot(40, 10)), start, axis=0), start))
        assert sorted(string.is_arc.tolist()) == [False, False, True, True]
        assert len(string.corner_mm) == 0
        arcs = string.is_arc
        assert string.radius_mm[arcs] == pytest.approx([10, 10], abs=0.1)
        assert np.sort(string.centre_mm[arcs][:, 0]) == pytest.approx([-20, 20], abs=0.15)
        assert np.degrees(string.turn_rad[arcs]) == pytest.approx([180, 180], abs=12)
        assert string.turn_rad.sum() + string.joint_rad.sum() == pytest.approx(2 * np.pi, abs=1e-6)


def test_a_disc_with_a_bore_is_two_arcs_of_opposite_turn() -> None:
    string = boundary_string([circle(30), circle(8, (10, 0))], [False, True])
    assert string.is_arc.tolist() == [True, True]
    assert string.radius_mm == pytest.approx([30, -8], abs=0.02)
    assert string.turn_rad == pytest.approx([2 * np.pi, -2 * np.pi], abs=1e-6)
    assert string.hole_mm == pytest.approx(np.array([[10, 0]]), abs=0.01)
    size = size_of_string(string)
    assert size.area_mm2 == pytest.approx(np.pi * (900 - 64), rel=2e-3)
    assert size.hole_count == 1
    assert size.hole_area_mm2 == pytest.approx([np.pi * 64], rel=5e-3)
    assert size.perimeter_mm == pytest.approx(60 * np.pi, rel=2e-3)


@pytest.mark.parametrize("radius", [6.0, 9.0, 14.0])
def test_rounded_corners_are_arcs_of_their_radius(radius: float) -> None:
    box = Polygon([(0, 0), (80, 0), (80, 50), (0, 50)]).buffer(-radius).buffer(radius, 64)
    string = only(noisy(dense(get_coordinates(box.exterior)[:-1]), 5))
    assert len(string.corner_mm) == 0
    assert string.is_arc.sum() == 4
    assert string.radius_mm[string.is_arc] == pytest.approx([radius] * 4, rel=0.06)
    corners = [(x, y) for x in (radius, 80 - radius) for y in (radius, 50 - radius)]
    apart = np.linalg.norm(string.centre_mm[string.is_arc][:, None] - corners, axis=2)
    assert apart.min(axis=0).max() < 0.5


def test_a_boundary_followed_the_other_way_is_the_same_string() -> None:
    there, back = only(dense(ELL)), only(dense(ELL)[::-1])
    assert np.sort(back.corner_turn_rad) == pytest.approx(np.sort(there.corner_turn_rad), abs=0.05)
    assert back.area_mm2 == pytest.approx(there.area_mm2, rel=1e-6)
    assert np.sort(back.length_mm) == pytest.approx(np.sort(there.length_mm), abs=0.6)


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
    string = only(noisy(dense(corners), seed))
    apart = np.linalg.norm(string.corner_mm[:, None] - corners[None], axis=2)
    assert (apart.min(axis=1) < 0.6).all()  # no corner is invented
    clear = bend > np.radians(30)
    assert (apart.min(axis=0)[clear] < 0.6).all()  # and none that is one is lost


def test_blurred_pixels_give_the_string_of_the_shape() -> None:
    lying = turned(ELL, 0.7)
    loops, holes = rasterised([lying, turned(circle(5, (12, 30)), 0.7)])
    string = boundary_string(loops, holes)
    assert len(string.corner_mm) == 6
    apart = np.linalg.norm(string.corner_mm[:, None] - lying[None], axis=2).min(axis=0)
    assert apart.max() < 0.25  # a pixel
    assert string.hole_area_mm2 == pytest.approx([25 * np.pi], rel=0.03)


def test_a_string_needs_an_outer_loop() -> None:
    with pytest.raises(NoOutlineError, match="no outer loop"):
        boundary_string([circle(5)], [True])


def test_a_line_there_and_back_encloses_nothing() -> None:
    there = np.column_stack([np.arange(40.0), np.zeros(40)])
    with pytest.raises(NoOutlineError, match="encloses nothing"):
        boundary_string([np.concatenate([there, there[::-1]])], [False])


def stroke_line(p: Array, q: Array) -> Stroke:
    return Stroke(p, q, None, None, 0.0, 0, -1)


def loop_of(strokes: list[Stroke], is_hole: bool = False) -> Loop:
    points = np.array([stroke.start for stroke in strokes])
    none = np.full(len(points), -1, dtype=np.int32)
    return Loop(points, none, none, np.zeros(len(points), bool), is_hole, tuple(strokes))


def test_a_models_strokes_give_the_string_of_its_shape() -> None:
    # half a disc of radius 20: one line, one half circle
    a, b = np.array([-20.0, 0.0]), np.array([20.0, 0.0])
    arc = Stroke(b, a, np.zeros(2), 20 * np.eye(2), np.pi, 0, -1)
    string = model_string([loop_of([stroke_line(a, b), arc])])
    assert string.is_arc.tolist() in ([False, True], [True, False])
    assert string.radius_mm.max() == pytest.approx(20, abs=0.05)
    assert len(string.corner_mm) == 2
    assert string.area_mm2 == pytest.approx(200 * np.pi, rel=2e-3)


def test_a_view_whose_second_axis_runs_down_is_taken_to_the_table() -> None:
    strokes = [stroke_line(p, q) for p, q in zip(ELL, np.roll(ELL, -1, axis=0), strict=True)]
    string = model_string([loop_of(strokes)], from_view=(100.0, 200.0))
    expected = np.array([100.0, 200.0]) + ELL * (1, -1)
    apart = np.linalg.norm(string.corner_mm[:, None] - expected[None], axis=2)
    assert apart.min(axis=0).max() < 0.05


def test_a_slit_no_picture_shows_is_not_part_of_a_models_string() -> None:
    wide = [[0, 0], [60, 0], [60, 19.95], [20, 19.95], [20, 20.05], [60, 20.05], [60, 40], [0, 40]]
    corners = np.array(wide, dtype=float)
    strokes = [
        stroke_line(p, q) for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    string = model_string([loop_of(strokes)])
    assert string.perimeter_mm == pytest.approx(200, rel=0.01)
    assert len(string.corner_mm) == 4


def test_a_sheet_on_edge_keeps_its_string() -> None:
    corners = np.array([[0, 0], [60, 0], [60, 0.2], [0, 0.2]], dtype=float)
    strokes = [
        stroke_line(p, q) for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    assert model_string([loop_of(strokes)]).perimeter_mm == pytest.approx(120.4, rel=0.01)


def test_a_view_with_a_speck_of_two_points_is_read() -> None:
    slit = [[0, 0], [60, 0], [60, 20], [20, 20], [20, 20.1], [60, 20.1], [60, 40], [0, 40]]
    corners = np.array(slit, dtype=float)
    strokes = [
        stroke_line(p, q) for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    a, b = np.array([5.0, 5.0]), np.array([5.1, 5.0])
    speck = loop_of([stroke_line(a, b), stroke_line(b, a)], is_hole=True)
    string = model_string([loop_of(strokes), speck])
    assert string.perimeter_mm == pytest.approx(200, rel=0.01)
    assert len(string.hole_mm) == 0
