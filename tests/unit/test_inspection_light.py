"""Bounds of a lamp's light on a posed part: shadow borders, bounced light, highlights."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, mesh_of, solid_of
from numpy.typing import NDArray
from shown_part import CAMERA, FRONT

from controller.imaging import Camera, PointLamp, RayCaster, ViewMaps, render_maps, view_roi
from controller.inspection.lit.bounce import UNEVEN_MM, find_neighbours
from controller.inspection.lit.finish import (
    ALBEDO,
    HIGHLIGHT_WIDTHS_RAD,
    LOBE_SR,
    Finish,
    Polish,
    finish_of,
)
from controller.inspection.lit.light import Light, bound_light
from controller.inspection.lit.surface import Surface, find_surface

STEP = 4
SIDE = PointLamp("side", np.array([[-470.0, -620, 370]]))
RING = PointLamp.ring("ring", np.array([0.0, -690, 0]), np.array([0.0, 1, 0]), 60.0)


@cache
def corner(lamp_name: str) -> tuple[Light, Surface, NDArray[np.float64]]:
    """A plate with a wall 20 mm high along its left side, seen from the front; part points too."""
    solid = solid_of(box(60, 60, 10) + box(8, 60, 30).translate((-26, 0, 10)))
    T = np.eye(4)
    T[:3, :3] = FRONT
    caster = RayCaster(solid.mesh)
    roi = view_roi(solid.mesh.vertices, T, CAMERA)
    assert roi is not None
    maps = render_maps(caster, T, CAMERA, roi, STEP)
    surface = find_surface(solid, maps, T, CAMERA, STEP)
    lamp = SIDE if lamp_name == "side" else RING
    about = find_neighbours(surface, caster, T, CAMERA, None)
    light = bound_light(surface, caster, T, CAMERA, lamp, None, about)
    return light, surface, surface.points @ T[:3, :3]


def floor_between(lamp: str, x0: float, x1: float) -> tuple[Light, NDArray[np.bool_]]:
    """The light, and which pixels see the plate so far right of its middle [mm]."""
    light, surface, points = corner(lamp)
    here = np.zeros(surface.seen.shape, dtype=bool)
    x, y, z = points.T
    here[surface.seen] = (x > x0) & (x < x1) & (np.abs(y) < 20) & (np.abs(z - 5) < 0.1)
    assert here.sum() > 20
    return light, here


def test_the_bounds_hold_the_light_between_them() -> None:
    for lamp in ("side", "ring"):
        light, surface, _ = corner(lamp)
        assert (light.least <= light.most + 1e-6).all()
        assert (light.least <= light.open + 1e-6)[surface.seen].all()
        for dim, bright in light.glints:
            assert (dim <= bright + 1e-6).all()


def test_in_the_open_the_bounds_are_tight_and_nothing_bounces() -> None:
    light, here = floor_between("side", 18, 26)
    assert (light.most - light.least)[here].max() < 0.06
    assert light.least[here].min() > 0.4
    assert light.bounced.matt[here].max() < 0.05


def test_behind_a_wall_it_is_dark_and_at_the_border_of_its_shadow_unknown() -> None:
    # the lamp stands 37 degrees to the left: 20 mm of wall throw a shadow of 13 to 15 mm
    light, here = floor_between("side", -21, -15)
    assert light.most[here].max() < 0.02
    light, here = floor_between("side", -9.5, -5.5)
    width = (light.most - light.least)[here]
    assert width.max() > 0.5
    assert (light.open[here] > 0.4).all()


def test_beside_a_wall_light_may_bounce_the_more_the_nearer() -> None:
    light, near = floor_between("ring", -21, -18)
    _, far = floor_between("ring", 5, 10)
    assert light.bounced.matt[near].mean() > 2 * light.bounced.matt[far].mean()
    # half the sky is wall at most, and no wall throws back more than it gets
    assert light.bounced.matt.max() < 0.5 * ALBEDO * 1.2


def test_a_wall_that_the_lamp_does_not_reach_throws_nothing() -> None:
    # the side lamp stands behind the wall: its side toward the floor is dark
    light, here = floor_between("side", -21, -18)
    assert light.bounced.matt[here].max() == 0.0


def finish_with(width: int, sigma: float = 1e-6) -> Finish:
    """A finish with highlights of one width alone, as bright as its matt share."""
    count = len(HIGHLIGHT_WIDTHS_RAD)
    peaks, covariance = np.eye(count)[width], sigma**2 * np.eye(count)
    return Finish(tuple(peaks.tolist()), tuple(map(tuple, covariance.tolist())))


def test_a_polished_wall_mirrors_the_lamp_where_the_lamp_shines_on_both() -> None:
    # the side lamp stands to the left, 37 degrees up: the step's other side is in its own shadow
    light, surface, _ = corner("side")
    mirrored, _ = light.bounced.most_mirrored(finish_with(0))
    assert mirrored[surface.seen].max() == 0.0
    # the ring stands above the floor, and grazes the wall: its image lies deep in the wall
    light, near = floor_between("ring", -21.5, -20)
    _, far = floor_between("ring", 18, 26)
    mirrored, _ = light.bounced.most_mirrored(finish_with(0))
    assert mirrored[near].mean() > 10 * mirrored[far].mean()


def test_what_a_polished_surface_mirrors_is_blurred_by_twice_the_tilt_of_its_facets() -> None:
    # facets turned by a normal deviate mirror a ray from square above to a screen 10 mm away
    rng = np.random.default_rng(5)
    width = min(HIGHLIGHT_WIDTHS_RAD)
    slopes = np.tan(rng.normal(0.0, width, (20_000, 2)))
    normals = np.column_stack([slopes, np.ones(len(slopes))])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    mirrored = 2 * normals[:, 2:] * normals - [0, 0, 1]
    landed_mm = 10.0 * mirrored[:, :2] / mirrored[:, 2:]
    spread_mm = 1.4826 * float(np.median(np.abs(landed_mm)))
    assert spread_mm == pytest.approx(10.0 * 2.0 * width, rel=0.06)


@pytest.mark.parametrize("width", range(len(HIGHLIGHT_WIDTHS_RAD)))
def test_a_mirror_image_is_uneven_beside_a_wall_and_even_farther_off(width: int) -> None:
    shares = []
    for x0, x1 in ((-21.5, -20), (2, 10)):
        light, here = floor_between("ring", x0, x1)
        mirrored, uneven = light.bounced.most_mirrored(finish_with(width))
        assert (uneven <= mirrored + 1e-6).all()
        shares.append(uneven[here].sum() / mirrored[here].sum())
    near, far = shares
    # 1 mm of a wall 20 mm high is seen from so near; from 24 to 32 mm away none of it is
    spread = 2 * HIGHLIGHT_WIDTHS_RAD[width]
    assert far < 1 / (1 + (24 * spread / UNEVEN_MM) ** 2) < 0.5 * near


def test_a_polished_surface_mirrors_the_highlight_on_its_neighbour() -> None:
    # of a finish with twice the highlights, a mirror shows twice as bright ones
    light, near = floor_between("ring", -21.5, -20)
    count = len(HIGHLIGHT_WIDTHS_RAD)
    sure = tuple(map(tuple, (1e-12 * np.eye(count)).tolist()))
    per_matt = []
    for peak in (4.0, 8.0):
        finish = Finish((0.0, peak, 0.0, 0.0), sure)
        mirrored, _ = light.bounced.most_mirrored(finish)
        per_matt.append(mirrored[near].mean() / finish.albedo)
    # highlights on highlights grow with the square, the rest with the first power
    assert 2.2 < per_matt[1] / per_matt[0] <= 4.0


# --- what pictures tell of a finish --------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 1])
def test_a_highlight_sends_as_much_light_as_its_solid_angle_holds(number: int) -> None:
    # beside a matt surface of the same peak, which sends pi steradians of it
    theta = np.linspace(0.0, np.pi / 2, 20_001)
    lobe = np.exp(-0.5 * (theta / 2 / HIGHLIGHT_WIDTHS_RAD[number]) ** 2) * np.sin(theta)
    sent = 2 * np.pi * float(np.trapezoid(lobe, theta)) / np.pi
    assert LOBE_SR[number] == pytest.approx(sent, rel=0.05)


def test_no_finish_reflects_more_light_than_it_may() -> None:
    for peak in (0.0, 1.0, 30.0):
        one = Polish(np.array([0.0, peak, 0.5 * peak, 0.0]), 1e6 * np.eye(4))
        finish = finish_of([one])
        sent = finish.albedo * (1.0 + np.maximum(finish.peaks, 0.0) @ LOBE_SR)
        assert sent == pytest.approx(ALBEDO, rel=1e-3)


def test_pictures_together_tell_more_of_a_finish_and_none_tells_nothing() -> None:
    one = Polish(np.array([0.1, 0.4, 0.8, 0.2]), np.diag([0.5, 1.0, 4.0, 9.0]))
    lobes = np.eye(4)
    open_, few, many = (finish_of([one] * n).brightest(lobes) for n in (0, 2, 50))
    assert (open_ > few).all()
    assert (few > many).all()
    assert finish_of([]).peaks == (0.0, 0.0, 0.0, 0.0)


def test_pictures_that_disagree_are_less_sure_by_as_much_as_they_disagree() -> None:
    told = 25.0 * np.eye(4)
    low, high = np.full(4, 1.0), np.full(4, 3.0)
    agree = finish_of([Polish(low, told)] * 10)
    differ = finish_of([Polish(low, told), Polish(high, told)] * 5)
    # 1 off on either side of 2, where 0.2 is claimed: 25 times the variance, less the prior's part
    ratio = np.diag(differ.covariance) / np.diag(agree.covariance)
    assert ratio == pytest.approx(np.full(4, 25.0), rel=0.25)


def test_highlights_that_are_known_to_be_wide_leave_little_unevenness() -> None:
    light, here = floor_between("ring", -18, -10)
    told = 100.0 * np.eye(4)
    wide = finish_of([Polish(np.array([0.0, 0.0, 0.0, 0.5]), told)])
    narrow = finish_of([Polish(np.array([5.0, 0.0, 0.0, 0.0]), told)])
    wide_uneven, narrow_uneven = (
        light.bounced.most_mirrored(finish)[1][here].mean() for finish in (wide, narrow)
    )
    assert wide_uneven < 0.5 * narrow_uneven


def test_what_falls_on_a_step_does_not_fall_on_the_face_around_it() -> None:
    light, surface, points = corner("ring")
    top = np.zeros(surface.seen.shape, dtype=bool)
    top[surface.seen] = (np.abs(points[:, 2] - 25) < 0.1) & (np.abs(points[:, 1]) < 20)
    # nothing stands above the wall's top, though the floor beside it is lit by the wall
    assert top.sum() > 20
    assert light.bounced.matt[top].max() == 0.0


def test_a_surface_square_to_camera_and_ring_lies_in_its_highlight() -> None:
    light, here = floor_between("ring", 5, 20)
    dim, bright = light.glints[-1]
    assert dim[here].min() > 0.9
    # the side lamp's mirror direction is far from the camera
    light, here = floor_between("side", 18, 26)
    _, bright = light.glints[0]
    assert bright[here].max() < 0.01
    assert len(light.glints) == len(HIGHLIGHT_WIDTHS_RAD)


# --- what is known exactly lies between the bounds: lamps of no extent, seen from above ---------

Array = NDArray[np.float64]
SIZE = (640, 512)


@cache
def above() -> Camera:
    """Straight down from 600 mm; world x is picture right, world y picture up."""
    K = np.array([[1800.0, 0, 319.5], [0, 1800.0, 255.5], [0, 0, 1.0]])
    T = np.diag([1.0, -1, -1, 1])
    T[2, 3] = 600.0
    return Camera(SIZE, K, np.zeros(5), T)


def at(x: float, y: float, z: float, turn_rad: float = 0.0) -> Array:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]]
    T[:3, 3] = x, y, z
    return T


def point_lamp(name: str, x: float, y: float, z: float) -> PointLamp:
    """A lamp of no extent; given by one point it would be taken for one of unknown size."""
    return PointLamp(name, np.array([[x, y, z]] * 2))


def light_of(
    body: Body, T: Array, lamp: PointLamp, others: RayCaster | None = None
) -> tuple[Light, ViewMaps]:
    solid = solid_of(body)
    caster = RayCaster(solid.mesh)
    maps = render_maps(caster, T, above(), (0, 0, *SIZE))
    surface = find_surface(solid, maps, T, above(), 1)
    about = find_neighbours(surface, caster, T, above(), others)
    return bound_light(surface, caster, T, above(), lamp, others, about), maps


def pixel_of(x: float, y: float, z: float) -> tuple[int, int]:
    u, v = np.round(above().project(np.array([[x, y, z]]))[0]).astype(int)
    return int(v), int(u)


@pytest.mark.parametrize("tilt_deg", [0, 30, 60, 80])
def test_a_plane_is_lit_by_the_cosine_and_the_distance_squared(tilt_deg: float) -> None:
    # a plate of 1 mm below the origin: its top passes through z = 0
    tilt = np.radians(tilt_deg)
    position = 400 * np.array([np.sin(tilt), 0, np.cos(tilt)])
    plate = box(200, 150, 1).translate((0, 0, -0.5))
    light, _ = light_of(plate, at(0, 0, 0), point_lamp("far", *position))
    assert light.open[pixel_of(0, 0, 0)] == pytest.approx(np.cos(tilt), abs=2e-3)
    for x, y in ((50, 20), (-60, -40), (80, 0)):
        towards = position - [x, y, 0]
        r = np.linalg.norm(towards)
        expected = towards[2] / r * (400 / r) ** 2
        here = pixel_of(x, y, 0)
        assert light.open[here] == pytest.approx(expected, rel=0.01)
        assert light.least[here] <= expected <= light.most[here]


def test_a_lamp_below_the_surface_gives_nothing() -> None:
    light, maps = light_of(box(100, 80, 10), at(0, 0, -5), point_lamp("below", 300.0, 0, -100))
    assert maps.mask.any()
    assert light.most.max() == 0


@pytest.mark.parametrize("d_mm", [3.0, 8.0])
def test_light_from_a_wall_is_what_the_wall_gets_and_the_floor_sees_of_it(d_mm: float) -> None:
    # a long wall of 20 mm, its right side at x = 4; a lamp at 45 degrees, far away on the right
    body = box(200, 400, 2).translate((0, 0, -1)) + box(4, 400, 20).translate((2, 0, 10))
    light, _ = light_of(body, at(0, 0, 0), point_lamp("right", 1e5, 0, 1e5))
    # a floor sees so much of the wall beside it, each part weighed by its cosine
    seen_share = (1 - d_mm / np.hypot(d_mm, 20.0)) / 2
    v, u = pixel_of(4 + d_mm, 0, 0)
    got = float(light.bounced.matt[v - 8 : v + 9, u].mean())
    assert got == pytest.approx(ALBEDO * np.cos(np.pi / 4) * seen_share, rel=0.15)


def test_a_wall_throws_a_shadow_as_long_as_the_lamp_is_low() -> None:
    # floor z = 0; a wall of 20 mm from x = 0 to 4; a lamp at 45 degrees, far away on the left
    body = box(200, 100, 2).translate((0, 0, -1)) + box(4, 100, 20).translate((2, 0, 10))
    far = 1e5
    light, _ = light_of(body, at(0, 0, 0), point_lamp("low", -far, 0, far))
    # the wall's far upper edge (4, 20) throws its shadow to x = 24
    for x, is_lit in (
        (-30, True),
        (-3, True),
        (10, False),
        (22.5, False),
        (25.5, True),
        (60, True),
    ):
        here = pixel_of(x, 10, 0)
        if is_lit:
            assert light.open[here] == pytest.approx(np.cos(np.pi / 4), rel=0.01), x
            assert 0.65 < light.least[here] <= np.cos(np.pi / 4) <= light.most[here] < 0.75, x
        else:
            assert light.most[here] == 0.0, x


def test_where_a_gripper_keeps_the_light_away_is_told_beside_the_parts_own_shading() -> None:
    lamp = point_lamp("above", 0.0, 0, 5000)
    # a bar of 10 mm along y at z = 50 in the world, and one that stands behind the lamp
    bar = box(10, 200, 2).translate((60, 0, 50))
    behind = box(500, 500, 2).translate((0, 0, 6000))
    plate, T = box(200, 100, 2).translate((0, 0, -1)), at(5, 0, 0, 0.2)
    held, _ = light_of(plate, T, lamp, RayCaster(mesh_of(bar + behind)))
    alone, _ = light_of(plate, T, lamp)
    assert np.array_equal(held.least, alone.least)
    assert np.array_equal(held.most, alone.most)
    assert held.touched[pixel_of(60, 5, 0)]
    assert not any(held.touched[pixel_of(x, 5, 0)] for x in (53, 67, 0, -60))


def test_a_ring_is_the_mean_of_its_points_round_the_axis() -> None:
    centre, axis = np.array([10.0, 20, 590]), np.array([0.0, 0, -1])
    ring = PointLamp.ring("ring", centre, axis, 50.0)
    away = ring.points_mm - centre
    assert np.linalg.norm(away, axis=1) == pytest.approx([50.0] * 6)
    assert away @ axis == pytest.approx([0.0] * 6, abs=1e-9)
    assert away.sum(axis=0) == pytest.approx([0, 0, 0], abs=1e-9)
    body, T = box(100, 80, 10), at(0, 0, -5)
    together, maps = light_of(body, T, ring)
    singles = [light_of(body, T, point_lamp("one", *p))[0].open for p in ring.points_mm]
    # the same reference distance for all: each is at the same distance within 1 %
    mean = np.mean(singles, axis=0)
    assert together.open[maps.mask] == pytest.approx(mean[maps.mask], rel=0.02)


def test_a_part_out_of_sight_is_dark_everywhere() -> None:
    light, maps = light_of(box(10, 10, 10), at(1000, 0, 0), PointLamp("l", np.zeros((1, 3))))
    assert not maps.mask.any()
    assert light.most.max() == 0
