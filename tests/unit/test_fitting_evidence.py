"""Edges found in grey levels, and what a picture says of a pose, on pictures known on paper."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
import shapely
from fitting_bodies import disturbed, model, motion, seen_loops, solid
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray
from table_pictures import SIZE, overhead, picture, resting, silhouette

from controller.cad import stable_poses
from controller.imaging import PointLamp
from controller.recognition.fitting import (
    EdgeFit,
    Evidence,
    FitOptions,
    GreyMeasure,
    ImageEdges,
    ModelEdgePoints,
    OutlineMeasure,
    Shading,
    asked_of_each_lamp,
    fit_edges,
    grey_evidence,
    outline_evidence,
    predict_edges,
    shading_fits,
    shown_edges,
)

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
CAMERA = overhead()
TABLE = np.array([[-150.0, -120, 0], [150, -120, 0], [150, 120, 0], [-150, 120, 0]])
RING = PointLamp.ring("ring", np.array([0.0, 0, 690]), np.array([0.0, 0, -1]), 120.0)
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
SIDE = PointLamp("side", np.array([[400.0, 350, 450]]))


def edges_at(
    pixels: Array, normals: Array, *, lift: float = 0.0, on_outline: bool = True, jump: float = 0.0
) -> ModelEdgePoints:
    n = len(pixels)
    return ModelEdgePoints(
        np.zeros((n, 3)),
        pixels,
        normals,
        np.full(n, on_outline),
        np.full(n, lift),
        np.full(n, jump),
        0.3,
    )


def along(ring: shapely.LinearRing, count: int, clear_px: float) -> tuple[Array, Array]:
    """Points on a polygon's sides away from its corners, and unit normals out of it."""
    corners = shapely.MultiPoint(np.asarray(ring.coords))
    at = np.linspace(0, ring.length, count, endpoint=False)
    here, there = ring.interpolate(at), ring.interpolate(at + 0.01)
    keep = shapely.distance(here, corners) > clear_px
    p, q = (shapely.get_coordinates(points)[keep] for points in (here, there))
    tangent = (q - p) / np.linalg.norm(q - p, axis=1)[:, None]
    out = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    return p, out if ring.is_ccw else -out


# --- edges in grey levels -----------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.785, 1.2])
@pytest.mark.parametrize("blur_px", [0.5, 0.9, 1.4])
def test_edges_of_a_picture_are_found_to_a_tenth_of_a_pixel(angle: float, blur_px: float) -> None:
    shape = shapely.affinity.rotate(shapely.box(250.3, 180.7, 480.1, 330.4), np.degrees(angle))
    image = picture([shape], blur_px=blur_px, noise=0.0)
    pixels, normals = along(shape.exterior, 400, clear_px=12.0)
    measure = GreyMeasure(image, (0, 0), is_lit=False)
    for away in (-2.3, -1.0, 0.0, 0.4, 2.6):
        asked = pixels + away * normals
        found = measure.gaps(asked, normals, edges_at(asked, normals), 4.0)
        off = found.gap_px + away
        assert abs(np.mean(off)) < 0.05
        assert np.sqrt(np.mean(off**2)) < 0.1
        assert np.abs(off).max() < 0.2  # between whole pixels a parabola is not the edge's shape
        assert (found.weight == 1.0).all()


def test_noise_moves_edges_by_its_share_of_the_contrast() -> None:
    shape = shapely.affinity.rotate(shapely.box(250.3, 180.7, 480.1, 330.4), 0.4, use_radians=True)
    pixels, normals = along(shape.exterior, 400, clear_px=12.0)
    measure = GreyMeasure(picture([shape], noise=4.0), (0, 0), is_lit=False)
    gaps = measure.gaps(pixels, normals, edges_at(pixels, normals), 3.0).gap_px
    assert np.isfinite(gaps).all()
    assert np.std(gaps) < 0.1
    assert abs(np.mean(gaps)) < 0.02


def test_a_crop_is_measured_in_pixels_of_the_whole_picture() -> None:
    shape = shapely.box(250.3, 180.7, 480.1, 330.4)
    image = picture([shape], noise=0.0)
    pixels, normals = along(shape.exterior, 200, clear_px=12.0)
    whole = GreyMeasure(image, (0, 0), is_lit=False)
    part = GreyMeasure(np.ascontiguousarray(image[150:360, 200:520]), (200, 150), is_lit=False)
    edges = edges_at(pixels, normals)
    a, b = (m.gaps(pixels, normals, edges, 3.0).gap_px for m in (whole, part))
    assert a == pytest.approx(b, abs=1e-4)


def test_where_nothing_is_nothing_is_found() -> None:
    shape = shapely.box(250.3, 180.7, 480.1, 330.4)
    image = picture([shape], noise=1.5)
    pixels, normals = along(shape.exterior, 200, clear_px=40.0)
    measure = GreyMeasure(image, (0, 0), is_lit=False)
    far = pixels + 25.0 * normals
    gaps = measure.gaps(far, normals, edges_at(far, normals), 4.0).gap_px
    # 3 deviations of the noise: one in a few hundred, and there are ten places to look
    assert np.isnan(gaps).mean() > 0.9


def two_edges(bright: int) -> Grey:
    """Dark, bright from column 40 on, dark again from 46 on; the second edge is the weaker one."""
    image = np.full((60, 90), 60, np.uint8)
    image[:, 40:46] = bright
    image[:, 46:] = 60 + (bright - 60) // 4
    return image


@pytest.mark.parametrize("is_lit", [True, False])
def test_under_lamps_an_edge_is_looked_for_with_its_brighter_side(is_lit: bool) -> None:
    # predicted half-way between both, with the brighter side along the normal or against it
    measure = GreyMeasure(two_edges(160), (0, 0), is_lit=is_lit)
    rows = np.arange(10.0, 50.0)
    pixels = np.column_stack([np.full(len(rows), 42.4), rows])
    normals = np.tile([1.0, 0.0], (len(rows), 1))
    for lift in (0.9, -0.9):
        edges = edges_at(pixels, normals, lift=lift, on_outline=False)
        gaps = measure.gaps(pixels, normals, edges, 5.0).gap_px
        rising, falling = 39.5 - 42.4, 45.5 - 42.4
        # without lamps, or with the right side, it is the stronger one
        expected = falling if is_lit and lift < 0 else rising
        assert gaps == pytest.approx(expected, abs=0.1)


def step_at(column: int, bright: int) -> Grey:
    image = np.full((60, 90), 60, np.uint8)
    image[:, column:] = bright
    return image


def down_column(column: float) -> ModelEdgePoints:
    rows = np.arange(10.0, 50.0)
    pixels = np.column_stack([np.full(len(rows), column), rows])
    return edges_at(pixels, np.tile([1.0, 0.0], (len(rows), 1)))


def test_an_edge_of_one_lamp_is_found_beside_a_stronger_one_of_another() -> None:
    weak, strong = step_at(40, 80), step_at(43, 200)
    joint = GreyMeasure(np.maximum(weak, strong), (0, 0), is_lit=True, others=(weak, strong))
    edges = down_column(39.5)
    together = joint.gaps(edges.pixels, edges.normals, edges, 5.0).gap_px
    assert together == pytest.approx(3.0, abs=0.2)
    gap, beside = joint.shown_by_any(edges, 5.0, 20)
    assert gap == pytest.approx(0.0, abs=0.1)
    # 20 px to the left and to the right there is nothing
    assert np.isnan(beside).all()
    left, right = joint.shown_by_any(down_column(59.5), 5.0, 20)[1]
    assert left == pytest.approx(0.0, abs=0.1)
    assert np.isnan(right).all()


def test_an_edge_is_sharp_where_brightness_changes_within_some_pixels() -> None:
    columns = np.arange(90.0)
    sharp = cv2.GaussianBlur(step_at(40, 180), (0, 0), 1.0)
    row = 60 + 120 * np.clip((columns - 34) / 12, 0, 1)
    half_shadow = np.tile(np.rint(row).astype(np.uint8), (60, 1))
    at = down_column(39.5)
    for image, is_sharp in ((sharp, True), (half_shadow, False)):
        measure = GreyMeasure(image, (0, 0), is_lit=True)
        assert (measure.are_sharp(at.pixels, at.normals) == is_sharp).all()
    assert len(measure.are_sharp(np.zeros((0, 2)), np.zeros((0, 2)))) == 0


def under_lamps(lamps: tuple[Grey, ...], edges: ModelEdgePoints) -> Evidence:
    brightest = np.max(lamps, axis=0)
    measure = GreyMeasure(brightest, (0, 0), is_lit=True, others=lamps)
    strong = ImageEdges.of(measure, np.ones(brightest.shape, dtype=np.bool_))
    shading = Shading(0.5, 9.0, 4.0, 100)
    return grey_evidence(edges, 0.2, 0.28, [measure], strong, shading, by_lamp=True)


def test_what_is_found_anywhere_is_told_as_chance() -> None:
    edges = down_column(39.5)
    plain = (step_at(40, 90), step_at(40, 120), step_at(40, 160))
    told = under_lamps(plain, edges)
    assert (told.outline, told.chance) == (1.0, 0.0)
    # stripes of 4 px about it: 5 px to the left and to the right there is one 1 px away
    columns = np.arange(90)
    dark = (columns >= 28) & (columns < 52) & (columns // 4 % 2 == 1)
    lamps = [np.where(dark, 60, level) * np.ones((60, 1)) for level in (90, 120, 160)]
    told = under_lamps(tuple(lamp.astype(np.uint8) for lamp in lamps), edges)
    assert told.outline == 1.0
    assert told.chance == 1.0


def test_what_a_part_beside_it_predicts_is_not_found_by_chance() -> None:
    edges, others = down_column(39.5), down_column(44.5)
    lamp = step_at(40, 90)
    lamp[:, 45:] = 180
    measure = GreyMeasure(lamp, (0, 0), is_lit=True, others=(lamp, lamp))
    off, chance = shown_edges(edges, measure, 0.28)
    assert off.max() < 0.5
    assert chance == pytest.approx(0.5)  # there is one on one side of it
    assert shown_edges(edges, measure, 0.28, [others])[1] == 0.0
    shading = Shading(0.5, 9.0, 4.0, 100)
    strong = ImageEdges.of(measure, np.ones(lamp.shape, dtype=np.bool_))
    known = grey_evidence(edges, 0.2, 0.28, [measure], strong, shading)
    told = asked_of_each_lamp(known, edges, (np.full(len(off), 2.0), 0.25))
    assert (told.outline, told.misfit_px, told.chance) == (0.0, 2.0, 0.25)
    assert told.explained == known.explained


def test_a_slow_slope_that_is_rounded_to_grey_levels_has_no_edges() -> None:
    slow = np.tile((np.arange(120) / 12).astype(np.uint8) + 8, (60, 1))
    everywhere = np.ones(slow.shape, dtype=np.bool_)
    assert len(ImageEdges.of(GreyMeasure(slow, (0, 0), is_lit=True), everywhere).points_px) == 0
    slow[:, 60:] += 6
    found = ImageEdges.of(GreyMeasure(slow, (0, 0), is_lit=True), everywhere).points_px
    assert set(found[:, 0]) <= {59.0, 60.0}
    assert len(found) > 50


def test_where_no_strong_edge_is_nothing_is_left_unexplained() -> None:
    even = np.full((60, 90), 60, np.uint8)
    told = under_lamps((even, even, even), down_column(39.5))
    assert (told.outline, told.explained, told.image_px) == (0.0, 1.0, 0.0)
    told = under_lamps((step_at(70, 200),) * 3, down_column(39.5))
    assert told.explained == 0.0


def test_an_edge_counts_by_how_surely_it_shows_under_lamps() -> None:
    measure = GreyMeasure(two_edges(160), (0, 0), is_lit=True)
    pixels = np.array([[40.0, 20.0]])
    normals = np.array([[1.0, 0.0]])

    def weight(lift: float, jump: float) -> float:
        edges = edges_at(pixels, normals, lift=lift, jump=jump, on_outline=False)
        return float(measure.gaps(pixels, normals, edges, 3.0).weight[0])

    assert 0 < weight(0.0, 0.0) < weight(0.2, 0.0) < weight(0.9, 0.0) == 1.0
    assert weight(0.2, 0.0) == weight(-0.2, 0.0)
    assert weight(0.0, 2.0) < weight(0.0, 10.0) == 1.0


# --- a whole pose -------------------------------------------------------------------------------


@cache
def lit(name: str, *, side: bool = False) -> tuple[Array, Grey]:
    """A part on the table with its largest face down, and its picture under lamps."""
    T = resting(solid(name), np.eye(3), 6.0, -9.0, 0.4)
    shots = Renderer(Scene(placed(solid(name).mesh, T), None, TABLE), CAMERA, seed=5)
    return T, shots.lit(SIDE if side else RING)


@pytest.mark.parametrize("side", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_fit_to_edges_under_lamps_finds_the_pose(side: bool) -> None:
    T, image = lit("pocket", side=side)
    start = disturbed("pocket", T, 0.6, -0.5, 0.02)
    measure = GreyMeasure(image, (0, 0), is_lit=True)
    options = FitOptions(reach_px=(6.0, 3.0))
    found = fit_edges(model("pocket"), start, CAMERA, measure, options)
    assert found is not None
    away = motion("pocket", found.T_world_part, T)
    assert np.abs(away[:2]).max() < 0.1
    assert abs(away[2]) < np.radians(0.1)
    assert not found.edges.on_outline.all()


def fitted(name: str, T: Array, loops: tuple[Array, ...]) -> tuple[EdgeFit, Evidence]:
    measure = OutlineMeasure.of_loops(loops)
    found = fit_edges(model(name), T, CAMERA, measure)
    assert found is not None
    return found, outline_evidence(found, measure, 0.28)


def test_a_perfect_outline_is_all_found_and_all_explained() -> None:
    T = resting(solid("plate"), np.eye(3), 10.0, 5.0, 0.7)
    _, evidence = fitted("plate", T, seen_loops("plate", T, CAMERA))
    assert evidence.outline > 0.99
    assert evidence.explained > 0.99
    assert evidence.misfit_px < 0.1
    # 200 mm round it and 2 pi 6 in it, seen from above, and a little of its sides
    assert evidence.outline_mm == pytest.approx(200 + 12 * np.pi, rel=0.12)


def test_what_is_missing_of_an_outline_is_told_as_a_share() -> None:
    T = resting(solid("plate"), np.eye(3), 0.0, 0.0, 0.7)
    outer, hole = seen_loops("plate", T, CAMERA)
    whole = fitted("plate", T, (outer, hole))[1]
    without = fitted("plate", T, (outer,))[1]
    share = len(hole) / (len(outer) + len(hole))
    # the bore's two rims, or one of them, count with the prediction
    assert 0.6 * share < whole.outline - without.outline < 2.2 * share
    assert without.explained > 0.99
    assert without.misfit_px > 3 * whole.misfit_px


def test_what_is_in_the_outline_and_not_predicted_is_told_as_a_share() -> None:
    T = resting(solid("plate"), np.eye(3), 0.0, 0.0, 0.7)
    outer, hole = seen_loops("plate", T, CAMERA)
    turn = np.arange(160) * 2 * np.pi / 160
    second = CAMERA.project(np.array([[-15.0, -10.0, 0.0]])) + 18.0 * np.column_stack(
        [np.cos(turn), np.sin(turn)]
    )
    _, evidence = fitted("plate", T, (outer, hole, second))
    share = 160 / (len(outer) + len(hole) + 160)
    assert evidence.outline > 0.99
    assert 1 - evidence.explained == pytest.approx(share, abs=0.02)


def test_evidence_under_lamps_is_for_the_right_pose_and_against_others() -> None:
    T, image = lit("pocket", side=True)
    measure = GreyMeasure(image, (0, 0), is_lit=True)
    mask = np.zeros(SIZE[::-1], np.uint8)
    shape = silhouette(solid("pocket").mesh, T, CAMERA)
    cv2.fillPoly(mask, [np.round(np.asarray(shape.exterior.coords)).astype(np.int32)], 1)
    inside = cv2.erode(mask, np.ones((7, 7), np.uint8)) > 0
    strong = ImageEdges.of(measure, mask > 0)

    def told(pose: Array) -> Evidence:
        edges = predict_edges(model("pocket"), pose, CAMERA)
        (shading,) = shading_fits(model("pocket"), pose, CAMERA, [image], (0, 0), inside)
        return grey_evidence(edges, 0.2, 0.28, [measure], strong, shading)

    right = told(T)
    # the pocket is not in the middle: half a turn puts it elsewhere in the same outline
    turned = told(T @ HALF_TURN)
    assert right.inner > 0.7
    assert right.inner > turned.inner + 0.2
    assert right.inner_explained > turned.inner_explained + 0.2
    assert right.outline > 0.9
    assert right.misfit_px < 1.0
    assert turned.outline == pytest.approx(right.outline, abs=0.1)


def test_an_edge_that_a_pose_does_not_have_is_as_long_as_the_rim_it_is_of() -> None:
    # half a turn puts a pocket of 24 x 16 mm elsewhere; at its own place hardly a corner is left
    T, image = lit("pocket", side=False)
    shape = silhouette(solid("pocket").mesh, T, CAMERA)
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    within = shapely.contains_xy(shape.buffer(2), u.ravel(), v.ravel()).reshape(SIZE[::-1])

    def longest_mm(pose: Array, others: tuple[Grey, ...]) -> float:
        measure = GreyMeasure(image, (0, 0), is_lit=True, others=others)
        edges = predict_edges(model("pocket"), pose, CAMERA)
        strong = ImageEdges.of(measure, np.asarray(within))
        told = grey_evidence(edges, 0.2, 0.28, [measure], strong, Shading(0.5, 9.0, 4.0, 100))
        return told.unexplained_mm

    assert longest_mm(T, (image, image)) < 16
    both_rims_mm = 2 * 2 * (24 + 16)
    assert both_rims_mm / 2 < longest_mm(T @ HALF_TURN, (image, image)) < both_rims_mm
    # what one lamp alone shows may be a shadow's border
    plain = np.full_like(image, 120)
    for others in ((), (image,), (image, plain)):
        assert longest_mm(T @ HALF_TURN, others) == 0


def test_an_edge_that_one_lamp_alone_shows_may_be_a_shadows() -> None:
    at, plain = down_column(39.5), np.full((60, 90), 90, np.uint8)
    shadow, beside = step_at(40, 180), step_at(50, 180)
    for lamps, is_seen in (
        ((shadow, shadow, plain), True),
        ((shadow, plain, plain), False),
        ((shadow, beside, beside), False),
        ((shadow, step_at(40, 70), plain), False),  # a tenth as strong
    ):
        measure = GreyMeasure(shadow, (0, 0), is_lit=True, others=lamps)
        assert (measure.are_seen_twice(at.pixels, at.normals) == is_seen).all()
    assert len(measure.are_seen_twice(np.zeros((0, 2)), np.zeros((0, 2)))) == 0


def roof_inside(T: Array) -> NDArray[np.bool_]:
    shape = silhouette(solid("roof").mesh, T, CAMERA).buffer(-5)
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    return np.asarray(shapely.contains_xy(shape, u.ravel(), v.ravel()).reshape(SIZE[::-1]))


def test_shading_tells_two_slopes_apart_without_knowing_the_lamps() -> None:
    # two slopes, one short and steep, the other long and gentle, in a rectangular outline
    T, image = lit("roof", side=True)
    inside = roof_inside(T)
    (right,) = shading_fits(model("roof"), T, CAMERA, [image], (0, 0), inside)
    (turned,) = shading_fits(model("roof"), T @ HALF_TURN, CAMERA, [image], (0, 0), inside)
    assert right.area_px == turned.area_px == inside.sum()
    assert right.variance == turned.variance
    assert right.explained > 0.9
    assert turned.explained < right.explained - 0.15
    assert right.residual == pytest.approx((1 - right.explained) * right.variance, rel=1e-6)
    # shown by a crop it is the same
    crop = np.ascontiguousarray(image[200:500, 250:600])
    (there,) = shading_fits(model("roof"), T, CAMERA, [crop], (250, 200), inside[200:500, 250:600])
    assert there.explained == pytest.approx(right.explained, abs=0.01)


def test_brighter_lamps_change_no_share_that_is_explained() -> None:
    T, image = lit("roof", side=True)
    inside = roof_inside(T)
    for gain, offset in ((0.5, 0), (0.5, 60), (1.0, 20)):
        grey = np.asarray(np.round(gain * image + offset), dtype=np.uint8)
        (told,) = shading_fits(model("roof"), T, CAMERA, [grey], (0, 0), inside)
        assert told.explained > 0.9


def test_an_even_patch_explains_nothing_and_claims_nothing() -> None:
    T, image = lit("roof", side=True)
    inside = roof_inside(T)
    (even,) = shading_fits(model("roof"), T, CAMERA, [np.full_like(image, 120)], (0, 0), inside)
    assert (even.explained, even.variance) == (0.0, 0.0)
    (none,) = shading_fits(model("roof"), T, CAMERA, [image], (0, 0), np.zeros_like(inside))
    assert (none.explained, none.area_px) == (0.0, 0)


@pytest.mark.parametrize("name", ["block", "plate"])
def test_a_pose_beside_the_truth_is_less_likely_by_every_measure(name: str) -> None:
    pose = stable_poses(solid(name))[0]
    T = resting(solid(name), pose.R, 5.0, 5.0, 0.3)
    loops = OutlineMeasure.of_loops(seen_loops(name, T, CAMERA))
    held = FitOptions(reach_px=(3.0,), steps=0)
    right = fit_edges(model(name), T, CAMERA, loops, held)
    assert right is not None
    told = outline_evidence(right, loops, 0.28)
    for step in ((1.2, 0.0, 0.0), (0.0, -1.2, 0.0), (0.0, 0.0, 0.08)):
        beside = fit_edges(model(name), disturbed(name, T, *step), CAMERA, loops, held)
        assert beside is not None
        other = outline_evidence(beside, loops, 0.28)
        assert other.outline < told.outline
        assert other.explained < told.explained
        assert other.misfit_px > told.misfit_px
