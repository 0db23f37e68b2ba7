"""Predicted pictures against silhouettes worked out on paper."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
import trimesh
from cad_solids import box, mesh_of, rod, solid_of
from numpy.typing import NDArray

from controller.imaging import Camera, RayCaster, ViewMaps, render_maps, view_roi

Array = NDArray[np.float64]
SIZE = (640, 512)
FOCAL = 1800.0
CENTRE = (319.5, 255.5)
HEIGHT = 600.0


@cache
def camera(distortion: tuple[float, ...] = (0, 0, 0, 0, 0)) -> Camera:
    """Straight down from 600 mm; world x is picture right, world y picture up."""
    K = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1.0]])
    T = np.diag([1.0, -1, -1, 1])
    T[2, 3] = HEIGHT
    return Camera(SIZE, K, np.array(distortion, float), T)


def at(x: float, y: float, z: float, turn_rad: float = 0.0) -> Array:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]]
    T[:3, 3] = x, y, z
    return T


def whole(body: trimesh.Trimesh, T: Array, cam: Camera, step_px: int = 1) -> ViewMaps:
    return render_maps(RayCaster(body), T, cam, (0, 0, *cam.size_px), step_px)


def grid() -> tuple[Array, Array]:
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(float)
    return u, v


def borders(mask: NDArray[np.bool_], px: int) -> NDArray[np.bool_]:
    kernel = np.ones((2 * px + 1, 2 * px + 1), np.uint8)
    wide = cv2.dilate(mask.astype(np.uint8), kernel)
    return np.asarray(wide != cv2.erode(mask.astype(np.uint8), kernel))


def test_a_sphere_shows_as_the_cone_of_its_tangents() -> None:
    radius, centre = 20.0, np.array([35.0, -22.0, 40.0])
    maps = whole(trimesh.creation.icosphere(subdivisions=6, radius=radius), at(*centre), camera())
    # a sight line d meets the sphere where (c.d)^2 >= d.d (c.c - r^2), c from the camera's eye
    u, v = grid()
    d = np.stack([(u - CENTRE[0]) / FOCAL, -(v - CENTRE[1]) / FOCAL, -np.ones_like(u)], axis=-1)
    c = centre - np.array([0, 0, HEIGHT])
    reach = (d @ c) ** 2 - (d * d).sum(axis=-1) * (c @ c - radius**2)
    expected = reach >= 0
    # the icosphere's facets lie up to 0.01 mm inside the sphere, which is 0.03 px
    differs = maps.mask != expected
    assert differs.sum() < 0.05 * borders(expected, 1).sum()
    assert not (differs & ~borders(expected, 1)).any()
    nearest = ((d @ c) - np.sqrt(np.maximum(reach, 0))) / (d * d).sum(axis=-1)
    inside = expected & ~borders(expected, 4)
    assert maps.depth_mm[inside] == pytest.approx(nearest[inside], abs=0.02)


def box_outline(cam: Camera, size: Array, T: Array) -> Array:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
    pixels = cam.project(corners @ T[:3, :3].T + T[:3, 3])
    return cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2).astype(float)


def inside_hull(outline: Array, u: Array, v: Array) -> Array:
    """Signed distance [px] of pixels from a convex outline, positive inside."""
    nearest = np.full(u.shape, np.inf)
    centre = outline.mean(axis=0)
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
        if (centre - a) @ normal < 0:
            normal = -normal
        nearest = np.minimum(nearest, (u - a[0]) * normal[0] + (v - a[1]) * normal[1])
    return nearest


@pytest.mark.parametrize("turn_deg", [0, 20, 45, 77])
@pytest.mark.parametrize("place", [(0, 0, 15), (60, -40, 15), (-90, 60, 40)])
def test_a_box_shows_as_the_hull_of_its_corners(
    place: tuple[float, float, float], turn_deg: float
) -> None:
    cam, size = camera(), np.array([60.0, 40.0, 30.0])
    T = at(*place, np.radians(turn_deg))
    maps = whole(mesh_of(box(*size)), T, cam)
    distance = inside_hull(box_outline(cam, size, T), *grid())
    assert maps.mask[distance > 0.01].all()
    assert not maps.mask[distance < -0.01].any()


def test_distortion_bends_the_predicted_silhouette_too() -> None:
    cam, size = camera((-0.2, 0.1, 5e-4, -4e-4, 0.0)), np.array([150.0, 110.0, 10.0])
    T = at(0, 0, 5, 0.1)
    maps = whole(mesh_of(box(*size)), T, cam)
    # points just inside and just outside the upper edge, projected with OpenCV's own formula
    rvec = cv2.Rodrigues(np.linalg.inv(cam.T_world_cam)[:3, :3])[0]
    tvec = np.linalg.inv(cam.T_world_cam)[:3, 3]
    for side, expected in ((-0.4, True), (0.4, False)):
        edge = np.array([[t, 55.0 + side, 5.0] for t in np.linspace(-70, 70, 60)])
        world = edge @ T[:3, :3].T + T[:3, 3]
        spots, _ = cv2.projectPoints(world, rvec, tvec, cam.K, cam.distortion)
        # 0.4 mm are 1.2 px, so the nearest pixel is on the same side of the edge
        u, v = np.round(spots.reshape(-1, 2)).astype(int).T
        seen = (u >= 0) & (v >= 0) & (u < SIZE[0]) & (v < SIZE[1])
        assert seen.sum() > 30
        assert (maps.mask[v[seen], u[seen]] == expected).all()


def test_depth_is_along_the_axis_and_the_triangle_is_the_one_seen() -> None:
    cam, part = camera(), solid_of(box(60, 40, 30))
    maps = whole(part.mesh, at(10, 5, 15), cam)
    # the top alone, seen from straight above, then the walls beside it
    u, v = (round(p) for p in cam.project(np.array([[10.0, 5.0, 30.0]]))[0])
    assert maps.depth_mm[v, u] == pytest.approx(HEIGHT - 30, abs=1e-3)
    assert part.mesh.face_normals[maps.triangle[v, u]] == pytest.approx([0, 0, 1])
    assert np.isinf(maps.depth_mm[~maps.mask]).all()


def test_a_region_and_every_second_pixel_are_cuts_of_the_whole() -> None:
    cam, body = camera(), mesh_of(box(60, 40, 30) - rod(8, 50, 32))
    T = at(10, 5, 15, 0.3)
    everything = whole(body, T, cam)
    region = (250, 180, 420, 330)
    cut = render_maps(RayCaster(body), T, cam, region)
    assert cut.roi == region
    assert np.array_equal(cut.triangle, everything.triangle[180:330, 250:420])
    coarse = whole(body, T, cam, step_px=2)
    assert np.array_equal(coarse.triangle, everything.triangle[::2, ::2])


def test_the_region_of_a_part_holds_it_with_the_margin_asked() -> None:
    cam, size = camera(), np.array([60.0, 40.0, 30.0])
    T = at(20, 10, 15, 0.4)
    region = view_roi(mesh_of(box(*size)).vertices, T, cam, margin_px=4)
    assert region is not None
    outline = box_outline(cam, size, T)
    assert region[:2] == pytest.approx(np.floor(outline.min(axis=0)) - 4)
    assert region[2:] == pytest.approx(np.ceil(outline.max(axis=0)) + 5)
    mask = whole(mesh_of(box(*size)), T, cam).mask
    mask[region[1] : region[3], region[0] : region[2]] = False
    assert not mask.any()


def test_the_region_ends_at_the_picture_and_is_none_beside_it() -> None:
    cam, vertices = camera(), mesh_of(box(60, 40, 30)).vertices
    half_out = view_roi(vertices, at(105, 0, 15), cam)
    assert half_out is not None
    assert half_out[2] == SIZE[0]
    assert view_roi(vertices, at(300, 0, 15), cam) is None


# --- rays ---------------------------------------------------------------------------------------


def test_a_ray_tells_triangle_and_distance_in_lengths_of_its_direction() -> None:
    body = mesh_of(box(20, 20, 20))
    caster = RayCaster(body)
    origins = np.array([[1.0, 2, 50], [1, 2, 50], [1, 2, 50], [30, 0, 0]])
    directions = np.array([[0, 0, -1.0], [0, 0, -4], [0, 0, 1], [-1, 0.1, 0]])
    triangle, distance = caster.first_hit(origins, directions)
    assert distance == pytest.approx([40, 10, np.inf, 20], abs=1e-4)
    assert triangle[2] == -1
    assert body.face_normals[triangle[[0, 1, 3]]] == pytest.approx(
        np.array([[0, 0, 1], [0, 0, 1], [1, 0, 0]])
    )


def test_a_ray_is_blocked_only_before_the_distance_given() -> None:
    caster = RayCaster(mesh_of(box(20, 20, 20)))
    origins, directions = np.array([[1.0, 2, 50]] * 2), np.array([[0, 0, -1.0], [0, 0, 1]])
    assert caster.blocked(origins, directions).tolist() == [True, False]
    assert caster.blocked(origins, directions, 39.0).tolist() == [False, False]
    assert caster.blocked(origins, directions, 41.0).tolist() == [True, False]


def test_no_rays_are_no_answers() -> None:
    caster = RayCaster(mesh_of(box(20, 20, 20)))
    triangle, distance = caster.first_hit(np.zeros((0, 3)), np.zeros((0, 3)))
    assert len(triangle) == len(distance) == 0
    assert len(caster.blocked(np.zeros((0, 3)), np.zeros((0, 3)))) == 0
