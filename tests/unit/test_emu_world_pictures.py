"""The emulated cameras' pictures: geometry, light and noise."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.special import erf

from emulators.world import Layout, PictureMaker, Scene, Solid, build_scene, read_layout
from emulators.world.layout import CameraLayout, LampLayout
from emulators.world.matter.solid import solid_of
from emulators.world.pictures import Order
from emulators.world.pictures.geometry import (
    Edges,
    Surface,
    corner_normals,
    distort,
    project,
    undistort,
)
from emulators.world.pictures.painter import sample_offsets
from emulators.world.pictures.picture import Eye
from emulators.world.pictures.sensor import (
    BLACK_GREY,
    ELECTRONS_PER_GREY,
    Exposure,
    blurred,
    develop,
)
from emulators.world.pictures.worker import Standpoint

Array = NDArray[np.float64]

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"
BLOCK_MM = (60.0, 40.0, 20.0)
BACKLIGHT, RING, SIDE = 0, 1, 2  # the order of the lamps in the cell file


@pytest.fixture(scope="module")
def layout() -> Layout:
    return read_layout(CELL)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Solid:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        return solid_of(trimesh.creation.box(BLOCK_MM), "block")


@pytest.fixture(scope="module")
def scene(layout: Layout, block: Solid) -> Scene:
    return build_scene(layout, [block])


@pytest.fixture(scope="module")
def overhead(scene: Scene) -> Eye:
    return Eye(scene, 0)


def at_rest(theta_rad: float, x_mm: float = 365.0, y_mm: float = 10.0) -> Array:
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    T = np.eye(4)
    T[:2, :2] = ((c, -s), (s, c))
    T[:3, 3] = x_mm, y_mm, BLOCK_MM[2] / 2.0
    return T


def grey(eye: Eye, poses: Mapping[str, Array], levels: Mapping[int, float]) -> Array:
    return (
        develop(blurred(eye.picture(poses, levels)), Exposure(0.010, bits=16), noisy=False).astype(
            float
        )
        / 257.0
    )


def silhouette_corners_px(camera: CameraLayout, T: Array) -> tuple[Array, Array]:
    """Return the image of the top edge nearest to the camera's left, computed by hand."""
    half = np.array(BLOCK_MM) / 2.0
    ends = np.array(((-half[0], half[1], half[2]), (half[0], half[1], half[2])))
    world = ends @ T[:3, :3].T + T[:3, 3]
    along = np.linspace(0.15, 0.85, 60)[:, None]
    points = world[0] * (1.0 - along) + world[1] * along
    # the pinhole and OpenCV's lens model, written out again
    R, t = camera.T_world_cam[:3, :3], camera.T_world_cam[:3, 3]
    seen = (points - t) @ R
    x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    bend = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * bend + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * bend + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    cx, cy = camera.centre_px
    pixels = np.stack((u * camera.focal_px + cx, v * camera.focal_px + cy), axis=1)
    outward = world[0] + (T[:3, 1]) - world[0]
    shifted = (points + outward - t) @ R
    direction = np.stack((shifted[:, 0] / shifted[:, 2] - x, shifted[:, 1] / shifted[:, 2] - y), 1)
    tangent = np.gradient(pixels, axis=0)
    normal = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.einsum("ij,ij->i", normal, direction))[:, None]
    return pixels, normal


def edge_offset_px(picture: Array, at: Array, normal: Array) -> float:
    """Return how far outside ``at`` a dark-to-bright edge lies, by fitting an error function."""
    reach = np.arange(-4.0, 4.01, 0.25)
    points = at + reach[:, None] * normal
    column, row = np.floor(points[:, 0]).astype(int), np.floor(points[:, 1]).astype(int)
    fx, fy = points[:, 0] - column, points[:, 1] - row
    values = (
        picture[row, column] * (1 - fx) * (1 - fy)
        + picture[row, column + 1] * fx * (1 - fy)
        + picture[row + 1, column] * (1 - fx) * fy
        + picture[row + 1, column + 1] * fx * fy
    )
    low, high = values[:4].mean(), values[-4:].mean()
    assert high - low > 100.0
    # the area under the transition places it, whatever blurs it, as long as the blur is even
    inside = (high - values).sum() * 0.25 / (high - low)
    return float(inside - 4.0 - 0.125)


@pytest.mark.parametrize("theta_deg", [0.0, 3.0, 17.0, 30.0, 45.0, 71.0, 90.0, 133.0, 200.0, 341.0])
def test_a_straight_edge_is_within_a_tenth_of_a_pixel_of_its_projection(
    overhead: Eye, theta_deg: float
) -> None:
    T = at_rest(math.radians(theta_deg))
    picture = grey(overhead, {"part 0": T}, {BACKLIGHT: 1.0})
    points, normals = silhouette_corners_px(overhead.camera, T)
    # a top edge is the outline only where the side below it is hidden: it faces away from the axis
    middle = points.mean(axis=0) - overhead.camera.centre_px
    if middle @ normals.mean(axis=0) < 0.0:
        T = at_rest(math.radians(theta_deg + 180.0))
        picture = grey(overhead, {"part 0": T}, {BACKLIGHT: 1.0})
        points, normals = silhouette_corners_px(overhead.camera, T)
    offsets = np.array(
        [edge_offset_px(picture, p, n) for p, n in zip(points, normals, strict=True)]
    )
    assert abs(offsets.mean()) < 0.05
    assert np.abs(offsets).max() < 0.1


def test_a_camera_that_was_moved_takes_pictures_from_there(scene: Scene) -> None:
    maker, T = PictureMaker(scene), at_rest(math.radians(17.0))
    before = maker.radiance(0, {"part 0": T}, {BACKLIGHT: 1.0})
    T_step = np.eye(4)
    T_step[:3, 3] = 6.0, -4.0, 0.0
    stood = scene.cameras[0]
    moved = replace(stood, T_world_cam=stood.T_world_cam @ T_step)
    maker.stand(Standpoint(0, moved.T_world_cam))
    after = maker.radiance(0, {"part 0": T}, {BACKLIGHT: 1.0})
    for picture, camera in ((before, stood), (after, moved)):
        points, normals = silhouette_corners_px(camera, T)
        offsets = [
            edge_offset_px(255.0 * picture, p, n) for p, n in zip(points, normals, strict=True)
        ]
        assert np.abs(offsets).max() < 0.1


def test_an_edge_far_off_the_axis_is_where_the_lens_bends_it_to(overhead: Eye) -> None:
    T = at_rest(0.3, x_mm=365.0, y_mm=170.0)
    picture = grey(overhead, {"part 0": T}, {BACKLIGHT: 1.0})
    points, normals = silhouette_corners_px(overhead.camera, T)
    straight = replace(overhead.camera, distortion=np.zeros(5))
    bent_px = np.linalg.norm(points - silhouette_corners_px(straight, T)[0], axis=1).min()
    assert bent_px > 0.4  # else this test could not fail
    offsets = [edge_offset_px(picture, p, n) for p, n in zip(points, normals, strict=True)]
    assert np.abs(offsets).max() < 0.1


def test_an_edge_is_as_soft_as_a_pixel_and_the_lens_make_it(overhead: Eye) -> None:
    # world x points up in the picture, so the block's long edge is upright at theta 0
    T = at_rest(0.0)
    picture = grey(overhead, {"part 0": T}, {BACKLIGHT: 1.0})
    points, normals = silhouette_corners_px(overhead.camera, T)
    assert abs(normals[30][0]) > 0.999
    row, sign = round(points[30][1]), int(np.sign(normals[30][0]))
    columns = round(points[30][0]) + sign * np.arange(-4, 5)
    values = picture[row, columns]
    share = (values - values[0]) / (values[-1] - values[0])
    order = np.argsort(points[:, 1])
    edge_px = np.interp(row, points[order, 1], points[order, 0])
    sigma_px = math.hypot(0.6, math.sqrt(1.0 / 12.0))  # blur, and a pixel's own width
    expected = (1.0 + erf((columns - edge_px) * sign / (sigma_px * math.sqrt(2.0)))) / 2.0
    assert np.abs(share - expected).max() < 0.06


def test_the_lens_model_runs_both_ways(layout: Layout) -> None:
    camera = layout.cameras["overhead"]
    rng = np.random.default_rng(1)
    xy = rng.uniform(-0.18, 0.18, (1000, 2))
    assert np.abs(undistort(distort(xy, camera.distortion), camera.distortion) - xy).max() < 1e-12


def test_a_ray_through_a_pixel_meets_what_projects_there(overhead: Eye) -> None:
    camera = overhead.camera
    pixels = np.array((0, 1279, 1280 * 1023, 1280 * 512 + 640))
    directions = overhead.rays.directions[pixels].astype(float)
    points = camera.T_world_cam[:3, 3] + 900.0 * directions
    there, depth = project(camera, points)
    assert depth == pytest.approx(np.full(4, 900.0), abs=1e-3)
    assert there == pytest.approx(np.stack((pixels % 1280, pixels // 1280), 1), abs=2e-3)


def test_the_subpixel_points_fill_a_pixel_from_every_side() -> None:
    offsets = sample_offsets().astype(float)
    assert np.abs(offsets).max() < 0.6
    for angle in np.linspace(0.0, math.pi, 24, endpoint=False):
        along = np.sort(offsets @ (math.cos(angle), math.sin(angle)))
        assert abs(along.mean()) < 0.01
        # the variance of a uniform square is 1/12 in every direction
        assert along.var() == pytest.approx(1.0 / 12.0, abs=0.012)


def test_light_adds_up_over_lamps_and_is_linear_in_their_levels(overhead: Eye) -> None:
    poses = {"part 0": at_rest(0.4)}
    alone = [overhead.picture(poses, {lamp: 1.0}) for lamp in (BACKLIGHT, RING, SIDE)]
    together = overhead.picture(poses, {BACKLIGHT: 0.2, RING: 0.5, SIDE: 0.9})
    summed = 0.2 * alone[0] + 0.5 * alone[1] + 0.9 * alone[2]
    # where the light jumps under one lamp only, the others' own pictures sample less finely
    difference = np.abs(together - summed)
    assert np.quantile(difference, 0.995) < 1e-5
    assert difference.max() < 0.02


def test_a_picture_without_light_is_black(overhead: Eye) -> None:
    picture = grey(overhead, {"part 0": at_rest(0.4)}, {RING: 0.0})
    assert np.abs(picture - BLACK_GREY).max() < 0.01


def test_grey_levels_are_those_of_a_well_exposed_camera(overhead: Eye) -> None:
    poses = {"part 0": at_rest(0.0, 365.0, 10.0)}
    u, v = (round(x) for x in project(overhead.camera, np.array(((365.0, 10.0, 20.0),)))[0][0])
    backlit = grey(overhead, poses, {BACKLIGHT: 1.0})
    assert 195.0 < backlit[100, 640] < 225.0
    assert backlit[v, u] < 12.0
    for lamp in (RING, SIDE):
        lit = grey(overhead, poses, {lamp: 1.0})
        assert 90.0 < lit[v, u] < 190.0
        assert 10.0 < lit[v, u - 300] < 70.0  # the matte table


def test_a_side_lamp_throws_a_shadow_away_from_itself(layout: Layout, overhead: Eye) -> None:
    T = at_rest(0.0)
    picture = grey(overhead, {"part 0": T}, {SIDE: 1.0})
    empty = grey(overhead, {}, {SIDE: 1.0})
    lamp = layout.lamps["table_side"].centre_mm
    # the top corner away from the lamp throws its shadow onto z = -1, where the panel is
    corner = T[:3, 3] + np.array((-30.0, -20.0, 10.0))
    along = (corner[2] + 1.0) / (lamp[2] - corner[2])
    tip = corner + (corner - lamp) * along
    foot = np.array((corner[0], corner[1], -1.0))
    inside = foot + 0.7 * (tip - foot)
    beyond = foot + 1.5 * (tip - foot)
    (iu, iv), (bu, bv) = np.rint(project(overhead.camera, np.array((inside, beyond)))[0]).astype(
        int
    )
    assert picture[iv, iu] < BLACK_GREY + 1.0 < empty[iv, iu] - 10.0
    assert picture[bv, bu] == pytest.approx(empty[bv, bu], abs=0.1)


def test_what_does_not_move_is_the_same_with_and_without_a_part(overhead: Eye) -> None:
    empty = overhead.picture({}, {BACKLIGHT: 1.0, SIDE: 1.0})
    full = overhead.picture({"part 0": at_rest(0.4)}, {BACKLIGHT: 1.0, SIDE: 1.0})
    changed = np.argwhere(np.abs(full - empty) > 1e-6)
    (top, left), (bottom, right) = changed.min(axis=0), changed.max(axis=0)
    assert bottom - top < 400
    assert right - left < 400


def test_twice_the_exposure_gives_twice_the_light() -> None:
    radiance = np.full((8, 8), 0.3, np.float32)
    once = develop(radiance, Exposure(0.005, bits=16), noisy=False) / 257.0 - BLACK_GREY
    twice = develop(radiance, Exposure(0.010, bits=16), noisy=False) / 257.0 - BLACK_GREY
    gained = develop(radiance, Exposure(0.005, gain=2.0, bits=16), noisy=False) / 257.0 - BLACK_GREY
    assert once == pytest.approx(np.full((8, 8), 31.5), abs=0.01)
    assert twice == pytest.approx(2.0 * once, rel=1e-3)
    assert gained == pytest.approx(twice, abs=0.01)


def test_too_much_light_saturates_and_does_not_wrap() -> None:
    radiance = np.full((16, 16), 4.0, np.float32)
    assert np.all(develop(radiance, Exposure(0.010)) == 255)
    assert np.all(develop(radiance, Exposure(0.010, bits=16)) == 65535)


def test_noise_is_that_of_photons_and_of_reading() -> None:
    shape = (400, 400)
    for radiance in (0.0, 0.1, 0.5):
        picture = (
            develop(np.full(shape, radiance, np.float32), Exposure(0.010, seed=5, bits=16)).astype(
                float
            )
            / 257.0
        )
        electrons = radiance * 210.0 * ELECTRONS_PER_GREY
        expected = math.sqrt(electrons + 12.0**2) / ELECTRONS_PER_GREY
        assert picture.mean() == pytest.approx(BLACK_GREY + radiance * 210.0, abs=0.03)
        assert picture.std() == pytest.approx(expected, rel=0.02)


def test_the_same_seed_gives_the_same_picture_and_another_does_not(scene: Scene) -> None:
    maker = PictureMaker(scene)
    poses = {"part 0": at_rest(0.4)}

    def take(seed: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        return maker.take(Order(1, 0, 0, poses, {BACKLIGHT: 1.0}, Exposure(0.01, 1.0, seed, 8)))

    first, again, other = take(7), take(7), take(8)
    assert np.array_equal(first, again)
    assert 0.2 < np.mean(first != other) < 1.0


def test_a_picture_is_made_anew_when_and_only_when_something_in_it_moves(scene: Scene) -> None:
    maker = PictureMaker(scene)
    poses = {"part 0": at_rest(0.4)}
    first = maker.radiance(0, poses, {BACKLIGHT: 1.0})
    assert maker.radiance(0, {"part 0": at_rest(0.4)}, {BACKLIGHT: 1.0, RING: 0.0}) is first
    far = {"part 0": at_rest(0.4), "arm gripper": np.eye(4)}
    far["arm gripper"][:3, 3] = 0.0, 600.0, 400.0  # out of the camera's sight
    assert maker.radiance(0, far, {BACKLIGHT: 1.0}) is first
    assert maker.radiance(0, {"part 0": at_rest(0.41)}, {BACKLIGHT: 1.0}) is not first


def test_a_lamp_that_droops_casts_no_ray_again_and_gives_the_same_picture(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses, bright = {"part 0": at_rest(0.4)}, {BACKLIGHT: 1.0, SIDE: 0.8}
    dim = {BACKLIGHT: 0.9, SIDE: 0.7}
    maker = PictureMaker(scene)
    maker.radiance(0, poses, bright)
    with monkeypatch.context() as patch:
        patch.setattr(Eye, "changes", None)  # whoever calls it fails
        found = maker.radiance(0, poses, dim)
    assert np.array_equal(found, PictureMaker(scene).radiance(0, poses, dim))


def test_normals_are_smooth_round_a_cylinder_and_not_over_its_rim() -> None:
    cylinder = trimesh.creation.cylinder(radius=10.0, height=20.0, sections=48)
    faces = np.asarray(cylinder.faces, dtype=np.int32)
    normals = corner_normals(np.asarray(cylinder.vertices), faces, smooth=True)
    corners = np.asarray(cylinder.vertices)[faces]
    side = np.abs(np.asarray(cylinder.face_normals)[:, 2]) < 0.5
    radial = corners[side] * (1.0, 1.0, 0.0)
    radial /= np.linalg.norm(radial, axis=2, keepdims=True)
    assert np.einsum("ijk,ijk->ij", normals[side], radial).min() > math.cos(math.radians(2.0))
    assert np.abs(normals[~side][..., 2]).min() > 0.9999


def test_a_camera_does_not_see_the_housing_it_sits_in(scene: Scene) -> None:
    inspection = Eye(scene, 1)
    panel = [lamp.name for lamp in scene.lamps].index("station_backlight")
    picture = inspection.picture({}, {panel: 1.0})
    assert picture[512, 640] > 0.9


def test_blocks_filled_from_their_corners_look_as_if_every_pixel_had_its_ray(
    overhead: Eye, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = {"part 0": at_rest(0.4)}
    levels = {RING: 1.0, SIDE: 1.0}
    quick = overhead.picture(poses, levels)
    everywhere = np.ones((1024, 1280), np.uint8)
    monkeypatch.setattr(overhead.painter, "edges", lambda in_play: everywhere)
    full = overhead.picture(poses, levels)
    off = np.abs(quick - full)
    assert (off > 0.003).sum() < 300  # 0.6 grey, but for the grain in shadows' borders
    assert np.abs(blurred(quick) - blurred(full)).max() < 0.015


def test_edges_are_drawn_where_a_curved_surface_turns_away(layout: Layout) -> None:
    camera = layout.cameras["overhead"]
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20.0)  # no crease anywhere
    faces = np.asarray(ball.faces, dtype=np.int32)
    surface = Surface(
        "ball",
        np.asarray(ball.vertices, dtype=float),
        faces,
        corner_normals(np.asarray(ball.vertices), faces, smooth=True),
        np.zeros(len(faces), np.int16),
        np.full(len(faces), -1, np.int16),
    )
    T = np.eye(4)
    T[:3, 3] = 360.0, 0.0, 20.0
    mask = np.zeros((1024, 1280), np.uint8)
    Edges(surface).draw(mask, camera, T)
    centre = project(camera, T[None, :3, 3])[0][0]
    rows, columns = np.nonzero(mask)
    radius_px = np.hypot(columns - centre[0], rows - centre[1])
    # a ball of radius r at distance d is seen under asin(r / d)
    expected_px = 3571.0 * math.tan(math.asin(20.0 / 1230.0))
    assert np.abs(radius_px - expected_px).max() < 5.0


# --- lamps of some extent: references that cast their own rays ----------------------------------


def points_of(lamp: LampLayout, aim_mm: Array) -> Array:
    """Return thousands of points of a lamp's light, a square grid cut out, (n, 3)."""
    axis = (aim_mm - lamp.centre_mm) / np.linalg.norm(aim_mm - lamp.centre_mm)
    inner, outer = 0.0, lamp.diameter_mm / 2.0
    if lamp.kind == "ring":
        inner, outer = lamp.radius_mm - lamp.width_mm / 2.0, lamp.radius_mm + lamp.width_mm / 2.0
    e1 = np.cross(axis, (0.6, 0.8, 0.0))
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    one = np.linspace(-outer, outer, 50 if lamp.kind == "spot" else 110)
    a, b = (grid.ravel() for grid in np.meshgrid(one, one + 0.1))
    in_it = (np.hypot(a, b) >= inner) & (np.hypot(a, b) <= outer)
    return np.asarray(lamp.centre_mm + a[in_it, None] * e1 + b[in_it, None] * e2)


def on_plate(eye: Eye, rng: np.random.Generator, count: int) -> tuple[NDArray[np.intp], Array]:
    """Return some pixels near the block, flat, and where their middles meet the plate, z = -1."""
    pixels = rng.integers(300, 724, count) * 1280 + rng.integers(428, 852, count)
    paths = eye.rays.directions[pixels].astype(float)
    eye_mm = eye.camera.T_world_cam[:3, 3]
    return pixels, eye_mm + paths * ((-1.0 - eye_mm[2]) / paths[:, 2])[:, None]


def share_past_box(
    point: Array, normal: Array, lights: Array, aim: Array, T: Array, half: Array
) -> float:
    """Return which share of a lamp's light reaches a matt point past a box, slab by slab."""
    towards = lights - point
    distance = np.linalg.norm(towards, axis=1)
    axis = (aim - lights.mean(axis=0)) / np.linalg.norm(aim - lights.mean(axis=0))
    beam = np.maximum(-(towards @ axis) / distance, 0.0) ** 6
    weight = np.maximum(towards @ normal, 0.0) / distance * beam / distance**2
    start, way = T[:3, :3].T @ (point - T[:3, 3]), towards @ T[:3, :3]
    with np.errstate(divide="ignore"):
        a, b = (-half - start) / way, (half - start) / way
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    open_way = ~((enter < leave) & (leave > 1e-9) & (enter < 1.0))
    return float((weight * open_way).sum() / weight.sum())


def at_mm(eye: Eye, picture: Array, points_mm: Array) -> Array:
    """Return a picture's values where points are seen, between pixels as they come."""
    pixels, _ = project(eye.camera, points_mm)
    column, row = np.floor(pixels).astype(int).T
    fx, fy = (pixels - np.floor(pixels)).T
    return np.asarray(
        picture[row, column] * (1 - fx) * (1 - fy)
        + picture[row, column + 1] * fx * (1 - fy)
        + picture[row + 1, column] * (1 - fx) * fy
        + picture[row + 1, column + 1] * fx * fy
    )


@pytest.mark.parametrize(
    ("lamp", "height_mm"), [(SIDE, 15.0), (SIDE, 60.0), (RING, 40.0), (RING, 150.0)]
)
def test_the_border_of_a_shadow_is_as_soft_as_the_lamp_is_wide(
    scene: Scene, overhead: Eye, lamp: int, height_mm: float
) -> None:
    """A block in the air shades the plate: against thousands of rays from each point."""
    T = at_rest(0.3)
    T[2, 3] = height_mm + BLOCK_MM[2] / 2.0
    half, up = np.array(BLOCK_MM) / 2.0, np.array((0.0, 0.0, 1.0))
    lights, aim = points_of(scene.lamps[lamp], scene.aims_mm[lamp]), scene.aims_mm[lamp]
    pixels, plate = on_plate(overhead, np.random.default_rng(5), 2000)
    eye_mm = overhead.camera.T_world_cam[None, :3, 3]
    wide = half + 1.0  # off the block's own outline
    seen = np.array([share_past_box(p, up, eye_mm, p, T, wide) > 0.5 for p in plate])
    lit = overhead.picture({"part 0": T}, {lamp: 1.0}).reshape(-1)[pixels]
    empty = overhead.picture({}, {lamp: 1.0}).reshape(-1)[pixels]
    seen &= empty > 0.05  # no shadow but the block's
    expected = np.array([share_past_box(p, up, lights, aim, T, half) for p in plate[seen]])
    off = lit[seen] / empty[seen] - expected
    border = (expected > 0.02) & (expected < 0.98)
    assert border.sum() > 20
    assert abs(off[border].mean()) < 0.01
    assert np.sqrt(np.mean(off[border] ** 2)) < 0.03  # of single pixels, before the lens
    assert np.abs(off[~border]).max() < 0.07


def test_a_point_far_away_is_lit_as_if_by_a_point(scene: Scene, overhead: Eye) -> None:
    """On the axis of a thin ring all its light comes at one angle, which has a closed form."""
    at = scene.aims_mm[RING] - (0.0, 0.0, 1.0)
    empty = overhead.picture({}, {RING: 1.0}).astype(float)
    lamp = scene.lamps[RING]
    reach_mm, away_mm = lamp.centre_mm[2], lamp.centre_mm[2] + 1.0
    opal, strength = 0.20, 0.95
    as_a_point = strength * opal * (reach_mm / away_mm) ** 2
    (value,) = at_mm(overhead, empty, at[None])
    cosine = away_mm / math.hypot(away_mm, lamp.radius_mm)
    # of the surface, of the beam to the sixth power, and of distance squared
    assert value == pytest.approx(as_a_point * cosine**9, rel=2e-3)
    assert value == pytest.approx(as_a_point, rel=0.015)


def test_a_floor_darkens_towards_a_wall_as_the_wall_hides_the_ring(
    layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step in a part: its lower floor against the reference, where the wall hides nothing too."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    floor = trimesh.creation.box((80.0, 60.0, 10.0))
    wall = trimesh.creation.box((30.0, 60.0, 40.0))
    wall.apply_translation((-25.0, 0.0, 15.0))
    step = solid_of(trimesh.boolean.union([floor, wall], engine="manifold"), "step")
    scene = build_scene(layout, [step])
    eye = Eye(scene, 1)
    lamp = [one.name for one in scene.lamps].index("station_ring")
    T = np.eye(4)
    T[:3, 1], T[:3, 2] = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)  # its floor faces the camera
    T[:3, 3] = scene.cameras[1].T_world_cam[0, 3], 0.0, 450.0
    picture = eye.picture({"part 0": T}, {lamp: 1.0})
    lights, aim = points_of(scene.lamps[lamp], scene.aims_mm[lamp]), scene.aims_mm[lamp]
    away_mm = np.linspace(0.3, 30.0, 100)  # from the wall
    local = np.stack((away_mm - 10.0, np.full(100, 3.0), np.full(100, 5.0)), axis=1)
    points = local @ T[:3, :3].T + T[:3, 3]
    T_wall = T.copy()
    T_wall[:3, 3] += T[:3, :3] @ (-25.0, 0.0, 15.0)
    half = np.array((15.0, 30.0, 20.0))
    share = np.array([share_past_box(p, T[:3, 2], lights, aim, T_wall, half) for p in points])
    assert share[0] < 0.6
    assert share[-1] > 0.999
    values = at_mm(eye, blurred(picture), points) / at_mm(eye, blurred(picture), points[-1:])
    assert np.abs(values - share)[away_mm > 0.6].max() < 0.05  # nearer, the wall is in the blur
    assert abs(np.mean(values - share)) < 0.015
    assert np.sqrt(np.mean(np.square(values - share))) < 0.02


def test_a_shadow_is_taken_anew_wherever_it_falls(scene: Scene) -> None:
    """What is kept of the fixed things must not differ from all of it cast anew."""
    eye = Eye(scene, 0)
    held = at_rest(0.7, 300.0, -60.0)
    held[2, 3] = 330.0
    tip, upper = np.eye(4), np.eye(4)
    tip[:3, 3] = 420.0, 150.0, 300.0  # in the picture and out of it
    upper[:3, 3] = 300.0, -200.0, 500.0  # up to above the side lamp
    poses = {"part 0": held, "arm gripper": tip, "upper": upper}
    quick = eye.picture(poses, {RING: 1.0, SIDE: 1.0})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eye, "_wanted", lambda movers, lit: np.ones((1024, 1280), bool))
        off = np.abs(quick - eye.picture(poses, {RING: 1.0, SIDE: 1.0}))
    assert (off > 0.003).mean() < 2e-3
    assert off.max() < 0.04  # a shadow left out or left behind would be ten times that


def test_two_workers_take_the_same_picture(scene: Scene, overhead: Eye) -> None:
    poses = {"part 0": at_rest(0.4)}
    again = Eye(scene, 0).picture(poses, {RING: 1.0, SIDE: 1.0})
    assert np.array_equal(again, overhead.picture(poses, {RING: 1.0, SIDE: 1.0}))
