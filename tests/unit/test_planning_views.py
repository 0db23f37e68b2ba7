"""What a part, a gripper and an arm leave in sight, against formulas, brute force and slow rays."""

from __future__ import annotations

from dataclasses import replace

import manifold3d
import numpy as np
import pytest
from cad_solids import box, rod, solid_of
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_cell import emulated_layout
from trimesh.ray.ray_triangle import RayMeshIntersector

from controller.cad import SurfaceSamples, sample_surface
from controller.imaging import Camera, RayCaster, inverse_pose, transform
from controller.planning import Box, Grasp
from controller.planning.geometry import segments_hit
from controller.planning.motion import Scene, inverse_rows, tcp_pose
from controller.planning.views import (
    VisibilityRules,
    even_sphere,
    hidden_by_gripper,
    hidden_ones,
    hold_up,
    holding_boxes,
    look_out,
    reachable_views,
    table_views,
    view_poses,
    visible_from,
    why_hidden,
)
from controller.planning.views.gripper import FINGER_SHADOW_MM

LAYOUT = emulated_layout()
RULES = VisibilityRules.of_station(LAYOUT, 70.0, 1.0)
BLOCK = solid_of(box(60, 40, 24), "block")
BLOCK_SAMPLES = sample_surface(BLOCK, 6.0)
CHANNEL = solid_of(box(60, 40, 30) - box(70, 24, 24).translate((0, 0, 8)), "channel")
CHANNEL_SAMPLES = sample_surface(CHANNEL, 5.0)


def turned(seed: int) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def pose_of(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


@pytest.mark.parametrize(
    ("limit_deg", "px_per_mm", "sharp"),
    [(70.0, 0.0, (0.0, np.inf)), (89.0, 4.0, (0.0, np.inf)), (80.0, 1.0, (688.0, 705.0))],
)
def test_a_block_shows_what_angle_pixels_and_depth_of_field_allow(
    limit_deg: float, px_per_mm: float, sharp: tuple[float, float]
) -> None:
    layout = replace(LAYOUT, inspection_sharp_mm=sharp)
    rules = VisibilityRules.of_station(layout, limit_deg, px_per_mm)
    vectors = even_sphere(40)
    seen = visible_from(BLOCK, BLOCK_SAMPLES, RayCaster(BLOCK.mesh), vectors, rules)
    expected = np.zeros_like(seen)
    for k, d in enumerate(vectors):
        sight = 700.0 * d - BLOCK_SAMPLES.points_mm  # a convex part hides nothing of what faces us
        cosine = (sight * BLOCK_SAMPLES.normals).sum(1) / np.linalg.norm(sight, axis=1)
        depth = 700.0 - BLOCK_SAMPLES.points_mm @ d
        expected[k] = cosine > np.cos(np.radians(limit_deg))
        expected[k] &= 3733.0 * cosine / depth > px_per_mm
        expected[k] &= (depth > sharp[0]) & (depth < sharp[1])
    assert 0 < expected.sum() < expected.size / 2
    np.testing.assert_array_equal(seen, expected)


def test_with_a_camera_that_looks_past_the_station_depths_hold_for_every_roll() -> None:
    away = 0.12
    R = LAYOUT.inspection.T_world_cam[:3, :3] @ np.array(
        [[np.cos(away), 0, np.sin(away)], [0, 1, 0], [-np.sin(away), 0, np.cos(away)]]
    )
    camera = Camera(
        LAYOUT.inspection.size_px,
        LAYOUT.inspection.K,
        LAYOUT.inspection.distortion,
        pose_of(R, LAYOUT.inspection.position_mm),
    )
    layout = replace(LAYOUT, inspection=camera)
    rules = VisibilityRules.of_station(layout, 70.0)
    assert rules.tilt_rad == pytest.approx(away)
    vectors = even_sphere(9)
    T, _ = view_poses(BLOCK, layout, vectors)
    for v, d in enumerate(vectors):
        low, high = rules.depth_bounds_mm(BLOCK_SAMPLES.points_mm - BLOCK.centroid_mm, d[None])[
            :, 0
        ]
        depths = np.stack(
            [(transform(p, BLOCK_SAMPLES.points_mm) - camera.position_mm) @ R[:, 2] for p in T[v]]
        )
        assert (depths >= low - 1e-6).all()
        assert (depths <= high + 1e-6).all()
        # and are no wider than twelve rolls can tell
        assert (depths.max(axis=0) >= low + 0.95 * (high - low)).all()


def test_sight_into_a_channel_is_what_slow_exact_rays_say() -> None:
    vectors = even_sphere(24)
    seen = visible_from(CHANNEL, CHANNEL_SAMPLES, RayCaster(CHANNEL.mesh), vectors, RULES)
    caster = RayMeshIntersector(CHANNEL.mesh)
    some = np.arange(0, len(CHANNEL_SAMPLES.points_mm), 7)
    start = CHANNEL_SAMPLES.points_mm[some] + 0.05 * CHANNEL_SAMPLES.normals[some]
    for k, d in enumerate(vectors):
        sight = CHANNEL.centroid_mm + 700.0 * d - start
        cosine = (sight * CHANNEL_SAMPLES.normals[some]).sum(1) / np.linalg.norm(sight, axis=1)
        facing = cosine > np.cos(np.radians(70.0))
        blocked = caster.intersects_any(start, sight)
        np.testing.assert_array_equal(seen[k, some], facing & ~blocked)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_hand_hides_what_lies_behind_its_boxes_wherever_it_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vectors = even_sphere(12)
    visible = rng.random((12, len(BLOCK_SAMPLES.points_mm))) < 0.5
    T_part_tcp = pose_of(turned(seed), rng.uniform(-20, 20, 3))
    boxes = [*LAYOUT.arm_gripper.body, *LAYOUT.arm_gripper.fingers(30.0)]
    boxes.append(Box(pose_of(turned(seed + 1), rng.uniform(-60, 60, 3)), np.array([9.0, 4.0, 30])))
    hidden = hidden_by_gripper(BLOCK, BLOCK_SAMPLES, visible, vectors, 700.0, T_part_tcp, boxes)
    assert not (hidden & ~visible).any()
    placed = [b.placed(T_part_tcp) for b in boxes]
    for k, d in enumerate(vectors):
        for grow_mm, claim in ((FINGER_SHADOW_MM - 1e-3, True), (FINGER_SHADOW_MM + 1e-3, False)):
            eye = BLOCK.centroid_mm + 700.0 * d
            behind = segments_hit(BLOCK_SAMPLES.points_mm, eye, placed, grow_mm) & visible[k]
            # a micrometre to either side is what single precision may decide either way
            assert (hidden[k] >= behind).all() if claim else (hidden[k] <= behind).all()


def test_fingers_that_spread_stand_between_the_contacts() -> None:
    grasp = Grasp("i", np.eye(4), 40.0, 34.0, 50.0, 0.2, 0.8, "arm", is_inner=True)
    *_, upper, lower = holding_boxes(LAYOUT.arm_gripper, grasp)
    assert upper.T[1, 3] + upper.half_mm[1] == pytest.approx(20.0)
    assert lower.T[1, 3] - lower.half_mm[1] == pytest.approx(-20.0)
    assert upper.half_mm[1] == pytest.approx(LAYOUT.arm_gripper.finger_thickness_mm / 2)


def reach_of(seed: int) -> tuple[Scene, np.ndarray, np.ndarray, object, object]:
    """A hand on the channel, and all it can show."""
    T_part_tcp = pose_of(turned(seed), np.zeros(3))
    T_part_tcp[:3, 3] = CHANNEL.centroid_mm + 8.0 * T_part_tcp[:3, 0]
    vectors = even_sphere(30)
    visible = visible_from(CHANNEL, CHANNEL_SAMPLES, RayCaster(CHANNEL.mesh), vectors, RULES)
    boxes = [*LAYOUT.arm_gripper.body, *LAYOUT.arm_gripper.fingers(40.0)]
    left = visible & ~hidden_by_gripper(
        CHANNEL, CHANNEL_SAMPLES, visible, vectors, 700.0, T_part_tcp, boxes
    )
    carried = Box(np.eye(4), np.array([30.0, 20.0, 15.0])).placed(inverse_pose(T_part_tcp))
    scene = Scene(LAYOUT, 40.0, LAYOUT.fixed_open_mm, carried)
    showing = hold_up(CHANNEL, CHANNEL_SAMPLES, LAYOUT, vectors)
    found = reachable_views(
        LAYOUT, scene, CHANNEL_SAMPLES, showing, left, T_part_tcp, LAYOUT.park_q
    )
    return scene, T_part_tcp, left, showing, found


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5])
def test_whatever_a_grip_is_said_to_show_nothing_of_arm_or_cell_stands_before(seed: int) -> None:
    scene, T_part_tcp, left, _, found = reach_of(seed)
    assert len(found.q) > 5
    eye = LAYOUT.inspection.position_mm
    for v, rows in found.q.items():
        assert found.shown[v].any()
        assert not (found.shown[v] & ~left[v]).any()
        assert scene.free(rows).all()
        for q in rows:
            T = tcp_pose(LAYOUT, q) @ inverse_pose(T_part_tcp)
            points = transform(T, CHANNEL_SAMPLES.points_mm[found.shown[v]])
            others = [b for n, b in scene.statics() if n != "inspection camera"]
            assert not segments_hit(points, eye, [*scene.arm_boxes(q), *others]).any()


def test_where_the_arm_hides_something_no_configuration_would_have_hidden_less() -> None:
    compared = 0
    eye = LAYOUT.inspection.position_mm
    for seed in range(8):
        scene, T_part_tcp, left, showing, found = reach_of(seed)
        for v in found.q:
            if (found.shown[v] == left[v]).all():
                continue
            poses = showing.T_world_part[v]
            index, _, q = inverse_rows(LAYOUT, poses @ T_part_tcp)
            free = scene.free(q)
            most = 0.0
            for k, row in zip(index[free], q[free], strict=True):
                points = transform(poses[k], CHANNEL_SAMPLES.points_mm)
                links = scene.arm_boxes(row)[:3]
                kept = left[v] & ~segments_hit(points, eye, links, FINGER_SHADOW_MM)
                most = max(most, float(CHANNEL_SAMPLES.areas_mm2[kept].sum()))
            shown = float(CHANNEL_SAMPLES.areas_mm2[found.shown[v]].sum())
            # the first twelve configurations are looked at
            assert shown <= most + 1e-9
            assert shown >= 0.95 * most
            compared += 1
    assert compared > 0


@pytest.mark.parametrize("length_mm", [60.0, 210.0, 420.0])
def test_a_part_counts_as_inside_the_picture_when_all_its_corners_are(length_mm: float) -> None:
    bar = solid_of(box(length_mm, 30, 20), "bar")
    vectors = even_sphere(15)
    T, inside = view_poses(bar, LAYOUT, vectors)
    for v in range(len(vectors)):
        for r in range(T.shape[1]):
            pixels = LAYOUT.inspection.project(transform(T[v, r], bar.mesh.vertices))
            whole = ((pixels >= 12) & (pixels <= np.array([1279, 1023]) - 12)).all()
            assert inside[v, r] == whole


def test_of_a_part_larger_than_the_picture_what_is_inside_it_counts() -> None:
    bar = solid_of(box(420, 30, 20), "bar")
    samples = sample_surface(bar, 12.0)
    vectors = even_sphere(20)
    visible = visible_from(bar, samples, RayCaster(bar.mesh), vectors, RULES)
    showing = hold_up(bar, samples, LAYOUT, vectors)
    assert 0 < len(showing.partly) < len(vectors)
    T_part_tcp = pose_of(turned(3), np.zeros(3))
    scene = Scene(LAYOUT, 30.0, LAYOUT.fixed_open_mm, None)
    found = reachable_views(LAYOUT, scene, samples, showing, visible, T_part_tcp, LAYOUT.park_q)
    partly = [v for v in found.q if v in showing.partly]
    assert partly
    for v in partly:
        assert found.shown[v].sum() < visible[v].sum()
        for q in found.q[v]:
            T = tcp_pose(LAYOUT, q) @ inverse_pose(T_part_tcp)
            pixels = LAYOUT.inspection.project(transform(T, samples.points_mm[found.shown[v]]))
            assert ((pixels > 11) & (pixels < np.array([1269, 1013]))).all()


def pose_on_table(z_mm: float) -> np.ndarray:
    return pose_of(np.eye(3), np.array([360.0, 10.0, z_mm]))[None]


def test_from_above_a_lying_block_shows_its_top_and_nothing_else_steep_enough() -> None:
    caster = RayCaster(BLOCK.mesh)

    def seen(px_per_mm: float, sharp: tuple[float, float] = (0.0, np.inf)) -> np.ndarray:
        return table_views(
            BLOCK_SAMPLES,
            caster,
            pose_on_table(12.0),
            LAYOUT.overhead,
            sharp,
            np.radians(60),
            px_per_mm,
        )[0]

    top = BLOCK_SAMPLES.normals[:, 2] > 0.99
    np.testing.assert_array_equal(seen(1.0), top)
    # the top is 1250 - 24 mm away: 3571 / 1226 = 2.91 pixels per mm, less what perspective takes
    np.testing.assert_array_equal(seen(2.90), top)
    assert not seen(2.92).any()
    np.testing.assert_array_equal(seen(1.0, (1225.0, 1227.0)), top)
    assert not seen(1.0, (1227.0, 1260.0)).any()


def hollow() -> manifold3d.Manifold:
    """A block with a void inside and a shaft, 5 mm square and 45 deep, at an odd angle."""
    shaft = box(5, 5, 100).translate((0, 0, 50)).rotate((17.0, 23.0, 0.0)).translate((8, 6, -25))
    return box(70, 60, 60) - shaft - rod(6, 12, 16).translate((-24, -20, 0))


def test_hard_spots_are_looked_for_on_purpose_and_what_stays_hidden_is_so_at_any_density() -> None:
    solid = solid_of(hollow(), "hollow")
    samples = sample_surface(solid, 6.0)
    caster = RayCaster(solid.mesh)
    void = np.linalg.norm(samples.points_mm - [-24, -20, 0], axis=1) < 9.0
    assert void.sum() >= 12
    lost = []
    for count in (40, 80, 160):
        found = look_out(solid, samples, caster, RULES, count)
        lost.append(~found.visible.any(axis=0))
        assert lost[-1][void].all()
        np.testing.assert_allclose(found.best_incidence_rad[void], np.pi / 2)
        # from inside the void every look outwards is stopped by the void's own wall
        inner = set(np.unique(samples.face_ids[void]).tolist())
        assert set(found.blocker[void].tolist()) <= inner
        assert "no place of the camera" in why_hidden(solid, found, void, 70.0)[0]
    np.testing.assert_array_equal(lost[0], lost[1])
    np.testing.assert_array_equal(lost[1], lost[2])
    even = visible_from(solid, samples, caster, even_sphere(40), RULES)
    assert (~even.any(axis=0)).sum() > lost[0].sum()  # the shaft's floor wants a look of its own
    floor = np.abs(samples.normals @ (found_axis := shaft_axis())) > 0.99
    floor &= np.abs((samples.points_mm - [8, 6, -25]) @ found_axis) < 0.1
    assert floor.any()
    assert not lost[0][floor].any()


def shaft_axis() -> np.ndarray:
    a, b = np.radians(17.0), np.radians(23.0)
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return about_y @ about_x @ np.array([0, 0, 1.0])


def test_a_spot_no_view_shows_says_what_stands_before_it_or_which_rule_it_breaks() -> None:
    slot = box(60, 60, 30) - box(70, 8, 14).translate((0, 0, 10)) - box(70, 30, 8)
    solid = solid_of(slot, "t_slot")
    samples = sample_surface(solid, 8.0)
    caster = RayCaster(solid.mesh)
    found = look_out(solid, samples, caster, replace(RULES, max_incidence_rad=np.radians(40)), 60)
    p, n = samples.points_mm, samples.normals
    # under the lips of the slot, in its middle: a look straight at it starts at the slot's floor
    lip = (n[:, 2] < -0.99) & (np.abs(p[:, 2] - 4.0) < 0.1) & (np.abs(p[:, 0]) < 15)
    floor = {f.id for f in solid.faces if f.kind == "plane" and f.normal[2] > 0.99}
    assert lip.sum() >= 3
    assert not found.visible[:, lip].any()
    assert set(found.blocker[lip].tolist()) <= floor
    assert (found.best_incidence_rad[lip] > np.radians(40)).all()
    assert not found.too_coarse[lip].any()
    reason, remedy = why_hidden(solid, found, lip, 40.0)
    assert reason.startswith("hidden by the part itself: seen")
    # the angle that is named as the smallest change must be one that helps
    told = int(remedy.split(" degrees")[0].split()[-1])
    assert 40 < told <= 90
    accepted = look_out(
        solid, samples, caster, replace(RULES, max_incidence_rad=np.radians(told)), 60
    )
    assert accepted.visible[:, lip].any(axis=0).mean() > 0.8
    fine = look_out(solid, samples, caster, replace(RULES, min_px_per_mm=9.0), 60)
    outside = (n[:, 2] > 0.99) & (p[:, 2] > 14)
    assert not fine.visible.any()
    assert fine.too_coarse[outside].all()
    assert not fine.blurred.any()
    assert why_hidden(solid, fine, outside, 70.0)[0].startswith("too coarse")
    soft = look_out(solid, samples, caster, replace(RULES, sharp_mm=(100.0, 300.0)), 60)
    assert not soft.visible.any()
    assert why_hidden(solid, soft, outside, 70.0)[0].startswith("out of focus")


def test_down_to_a_fifth_of_a_degree_within_the_limit_no_spot_is_called_hidden() -> None:
    width, depth = 8.0, 30.0
    solid = solid_of(box(60, 40, 40) - box(80, width, depth).translate((0, 0, 20 - depth / 2)))
    # on a wall of the slot, half-way along: the squarest line out passes over the other wall's lip
    steepest = np.radians([60.0, 67.0, 69.0, 69.7, 70.3, 71.0, 75.0])
    below = width * np.tan(steepest)
    points = np.column_stack([np.zeros(7), np.full(7, -width / 2), 20.0 - below])
    normals = np.tile([0.0, 1.0, 0.0], (7, 1))
    spots = SurfaceSamples(points, normals, np.zeros(7, dtype=np.int32), np.ones(7))
    few = even_sphere(40)
    found = hidden_ones(solid, spots, RayCaster(solid.mesh), RULES, few)
    assert found.is_hidden.tolist() == [False, False, False, False, True, True, True]
    # and those that are know how square they could be seen at best, as far as was looked
    assert (found.best_incidence_rad[4:] >= steepest[4:] - 1e-3).all()
