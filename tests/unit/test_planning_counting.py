"""What views are counted to show: lens, border, pixels, boxes, shadows, against slow formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cad_solids import box, rod, solid_of
from planning_cell import emulated_layout
from trimesh.ray.ray_triangle import RayMeshIntersector

from controller.cad import SurfaceSamples, counted_samples
from controller.imaging import Camera, RayCaster, inverse_pose, transform
from controller.planning import CellLayout, Grasp, PlanOptions
from controller.planning.geometry import segments_hit
from controller.planning.motion import Scene, inverse_rows, tcp_pose
from controller.planning.views import Counter, even_sphere, holding_boxes, view_poses
from controller.planning.views.gripper import FINGER_SHADOW_MM

PLATE = solid_of(
    box(110, 70, 14) - rod(9, 40, 96).translate((20, 5, 0)) - rod(5, 40, 64).translate((-30, 0, 0)),
    "plate",
)
EVERY = counted_samples(PLATE, 4.0)
SAMPLES = EVERY.rows(np.arange(0, len(EVERY.points_mm), 9))
CASTER = RayCaster(PLATE.mesh)
BORDER_PX = 12.0


def behind_a_lens(k1: float, scale: float = 1.0) -> CellLayout:
    """Return the emulated cell with other lenses before both cameras."""
    layout = emulated_layout()

    def other(camera: Camera) -> Camera:
        K = camera.K * np.array([[scale, scale, 1.0], [scale, scale, 1.0], [1.0, 1.0, 1.0]])
        distortion = np.array([k1, 0.1 * abs(k1), 1e-3, -1e-3, 0.0])
        return Camera(camera.size_px, K, distortion, camera.T_world_cam)

    return replace(layout, inspection=other(layout.inspection), overhead=other(layout.overhead))


def least_px_per_mm(camera: Camera, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the pixels of a millimetre in the worst of 180 directions along a surface."""
    u = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    least = np.full(len(points), np.inf)
    for turn in np.linspace(0.0, np.pi, 180, endpoint=False):
        half = 0.02 * (np.cos(turn) * u + np.sin(turn) * v)
        apart = camera.project(points + half) - camera.project(points - half)
        least = np.minimum(least, np.linalg.norm(apart, axis=1) / 0.04)
    return least


def slowly(
    layout: CellLayout,
    camera: Camera,
    T_world_part: np.ndarray,
    options: PlanOptions,
    boxes: list,
    samples: SurfaceSamples,
    sharp_mm: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return what is shown, and what hangs on less than rounding."""
    points = transform(T_world_part, samples.points_mm)
    normals = samples.normals @ T_world_part[:3, :3].T
    sight = camera.position_mm - points
    cosine = (sight * normals).sum(axis=1) / np.linalg.norm(sight, axis=1)
    depth = -sight @ camera.T_world_cam[:3, 2]
    limit = np.cos(np.radians(options.max_incidence_deg))
    pixels = camera.project(points)
    inset = np.minimum(pixels, np.array(camera.size_px) - 1 - pixels).min(axis=1)
    rate = least_px_per_mm(camera, points, normals)
    good = (cosine >= limit) & (depth >= sharp_mm[0]) & (depth <= sharp_mm[1])
    good &= (inset >= BORDER_PX) & (rate >= options.min_px_per_mm)
    narrow, wide = (
        segments_hit(points, camera.position_mm, boxes, FINGER_SHADOW_MM + by)
        for by in (-1e-6, 1e-6)
    )
    eye = transform(inverse_pose(T_world_part), camera.position_mm[None])[0]
    start = samples.points_mm + 0.02 * samples.normals
    hidden = RayMeshIntersector(PLATE.mesh).intersects_any(start, eye - start)
    unsure = (abs(inset - BORDER_PX) < 1e-6) | (abs(cosine - limit) < 1e-9) | (narrow != wide)
    unsure |= abs(rate - options.min_px_per_mm) < 2e-3 * options.min_px_per_mm
    return good & ~wide & ~hidden, unsure


@pytest.mark.parametrize(
    ("k1", "scale", "px_per_mm"),
    [(0.0, 1.0, 1.0), (-0.35, 1.0, 2.5), (0.3, 1.6, 4.0), (-0.35, 2.6, 7.0)],
)
def test_a_view_in_the_arm_gripper_shows_what_slow_formulas_allow(
    k1: float, scale: float, px_per_mm: float
) -> None:
    layout = behind_a_lens(k1, scale)
    options = PlanOptions(min_px_per_mm=px_per_mm)
    counter = Counter(PLATE, SAMPLES, layout, options, CASTER)
    T_part_tcp = np.eye(4)
    T_part_tcp[:3, :3] = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    T_part_tcp[:3, 3] = (-25.0, 30.0, 2.0)
    grasp = Grasp("g", T_part_tcp, 14.0, 20.0, 50.0, 0.2, 0.8, "arm")
    T, _ = view_poses(PLATE, layout, even_sphere(24))
    index, _, q = inverse_rows(layout, T[:, ::4].reshape(-1, 4, 4) @ T_part_tcp)
    compared = shown_count = cut_count = 0
    for _, row in list(zip(index, q, strict=True))[:: max(1, len(q) // 12)]:
        T_world_part = tcp_pose(layout, row) @ inverse_pose(T_part_tcp)
        boxes = [b.placed(tcp_pose(layout, row)) for b in holding_boxes(layout.arm_gripper, grasp)]
        scene = Scene(layout, grasp.opening_mm, layout.fixed_open_mm)
        boxes += [*scene.arm_boxes(row)[:3]]
        boxes += [b for name, b in scene.statics() if name != "inspection camera"]
        expected, unsure = slowly(
            layout,
            layout.inspection,
            T_world_part,
            options,
            boxes,
            SAMPLES,
            layout.inspection_sharp_mm,
        )
        found = counter.held_up(grasp, row)
        # of four lines two must be free: beside an edge of a shadow these differ from the one line
        assert (found != expected)[~unsure].mean() < 0.003
        compared += 1
        shown_count += int(expected.sum())
        cut_count += int((~expected).sum())
    assert compared >= 8
    assert shown_count > 100
    assert cut_count > 100


@pytest.mark.parametrize(("k1", "at"), [(-0.35, (360.0, 10.0)), (0.3, (300.0, 150.0))])
def test_a_look_at_the_table_shows_what_slow_formulas_allow(
    k1: float, at: tuple[float, float]
) -> None:
    layout = behind_a_lens(k1, 1.5)
    camera = layout.overhead
    T = np.eye(4)
    T[:3, 3] = (*at, 7.0)
    options = PlanOptions(min_px_per_mm=0.4)
    found = Counter(PLATE, SAMPLES, layout, options, CASTER).on_table(T)
    expected, unsure = slowly(layout, camera, T, options, [], SAMPLES, layout.overhead_sharp_mm)
    assert (found != expected)[~unsure].mean() < 0.003
    assert 0.02 < expected.mean() < 0.6


def test_some_of_the_points_are_counted_as_all_are() -> None:
    layout = emulated_layout()
    counter = Counter(PLATE, SAMPLES, layout, PlanOptions(), CASTER)
    T = np.eye(4)
    T[:3, 3] = (360.0, 10.0, 7.0)
    which = np.arange(0, len(SAMPLES.points_mm), 3)
    some = counter.of_rows(which)
    np.testing.assert_array_equal(some.on_table(T), counter.on_table(T)[which])
