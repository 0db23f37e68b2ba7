"""Whole plans for a recipe part, judged by triangles, FCL and rays of their own."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from planning_cell import PARTS, emulated_layout
from planning_checker import check
from trimesh.ray.ray_triangle import RayMeshIntersector

from controller.cad import StablePose, load_solid, make_solid, sample_surface, stable_poses
from controller.planning import (
    FaceToShowAgain,
    GiveStep,
    InArm,
    Look,
    NoPlanError,
    OutOfReachError,
    Pick,
    Plan,
    PlanOptions,
    PreparedPart,
    Present,
    ReceiveStep,
    plan_from,
    plan_part,
    prepare_part,
    resting_pose,
    shown_pose,
)
from controller.planning.regrasps import (
    is_pickable,
    is_steady,
    pick_paths,
    stands_steadily,
)
from drivers.umi_scara.model.kinematics import within_limits

LAYOUT = emulated_layout()
SOLID = load_solid(PARTS / "holder.stl")
SAMPLES = sample_surface(SOLID, 5.0)
POSE: StablePose = stable_poses(SOLID)[0]
T_START = resting_pose(SOLID, POSE, 350.0, 40.0, 0.7)
OPTIONS = PlanOptions(arm_grasps_per_pose=6, arm_grasps_round=10, fixed_grasps=10)


@pytest.fixture(scope="module")
def prepared() -> PreparedPart:
    return prepare_part(SOLID, SAMPLES, LAYOUT, OPTIONS)


@pytest.fixture(scope="module")
def plan(prepared: PreparedPart) -> Plan:
    return plan_part(SOLID, SAMPLES, POSE, T_START, LAYOUT, prepared=prepared)


def test_a_resting_part_touches_the_table_with_its_centre_of_mass_over_the_place() -> None:
    points = SOLID.mesh.vertices @ T_START[:3, :3].T + T_START[:3, 3]
    assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    com = T_START[:3, :3] @ SOLID.centroid_mm + T_START[:3, 3]
    np.testing.assert_allclose(com[:2], [350.0, 40.0], atol=1e-9)


@pytest.mark.parametrize("x_mm", [250.0, 350.0, 2000.0])
def test_a_part_is_pickable_where_there_is_a_way_to_pick_it(
    x_mm: float, prepared: PreparedPart
) -> None:
    T = resting_pose(SOLID, POSE, x_mm, 40.0, 0.7)
    try:
        found = bool(pick_paths(prepared, LAYOUT, T))
    except NoPlanError:
        found = False
    assert is_pickable(prepared, LAYOUT, T) == found
    assert found == (x_mm < 2000.0)


def test_nothing_touches_anything_along_the_whole_plan(plan: Plan) -> None:
    assert check(plan, LAYOUT, SOLID, T_START) == []


def test_the_way_round_the_fixture_is_free_with_the_jaws_as_they_let_go() -> None:
    # held across 25.4 mm, handed over, taken back across 63.5 mm: hands as wide as for the second
    # grip would pass on both sides of what hands as narrow as after the first run into
    block = make_solid(
        trimesh.creation.box((127.0, 63.5, 25.4)), "block", "0123456789abcdef", where="block"
    )
    lying = stable_poses(block)[2]
    T = resting_pose(block, lying, 350.0, 40.0, 0.7)
    made = plan_part(block, sample_surface(block, 8.0), lying, T, LAYOUT, options=OPTIONS)
    (over,) = (s for s in made.steps if isinstance(s, GiveStep))
    (back,) = (s for s in made.steps if isinstance(s, ReceiveStep))
    assert over.arm_open_mm < back.pre_open_mm - 30.0
    assert check(made, LAYOUT, block, T) == []


def test_every_waypoint_is_one_the_arm_accepts(plan: Plan) -> None:
    motions = []
    for step in (*plan.steps, *plan.place.values(), *plan.park.values()):
        for name in dir(step):
            value = getattr(step, name)
            if isinstance(value, tuple) and value and isinstance(value[0], np.ndarray):
                motions.append(np.stack(value))
    assert len(motions) > 10
    assert within_limits(np.vstack(motions)).all()


def test_the_part_is_one_and_the_same_on_both_sides_of_every_change_of_hands(plan: Plan) -> None:
    pick = next(s for s in plan.steps if isinstance(s, Pick))
    tip = LAYOUT.T_world_arm @ LAYOUT.arm.forward(pick.motion_down[-1])
    np.testing.assert_allclose(tip @ np.linalg.inv(pick.grasp.T_part_tcp), T_START, atol=0.05)
    give = next(s for s in plan.steps if isinstance(s, GiveStep))
    take = next(s for s in plan.steps if isinstance(s, ReceiveStep))
    given = shown_pose(LAYOUT, give.motion[-1], give.grasp.T_part_tcp)
    in_fixture = LAYOUT.T_world_fixed_tcp @ np.linalg.inv(give.fixed_grasp.T_part_tcp)
    taken = shown_pose(LAYOUT, take.approach[-1], take.grasp.T_part_tcp)
    np.testing.assert_allclose(given, in_fixture, atol=0.2)
    np.testing.assert_allclose(taken, in_fixture, atol=0.2)


def test_straight_ways_are_straight_and_keep_the_hand_as_it_is(plan: Plan) -> None:
    pick = next(s for s in plan.steps if isinstance(s, Pick))
    way = [pick.motion_in[-1], *pick.motion_down]
    ends = LAYOUT.arm.forward(np.stack([way[0], way[-1]]))
    along = ends[1, :3, 3] - ends[0, :3, 3]
    for a, b in pairwise(way):
        for share in np.linspace(0, 1, 9):
            tip = LAYOUT.arm.forward(a + share * (b - a))
            off = np.cross(tip[:3, 3] - ends[0, :3, 3], along / np.linalg.norm(along))
            assert np.linalg.norm(off) < 2.0


def test_every_view_has_the_part_at_the_station_inside_the_picture(plan: Plan) -> None:
    hull = SOLID.mesh.convex_hull.vertices
    for view in plan.presents:
        com = view.T_world_part[:3, :3] @ SOLID.centroid_mm + view.T_world_part[:3, 3]
        np.testing.assert_allclose(com, LAYOUT.station_mm, atol=0.5)
        towards = LAYOUT.inspection.position_mm - LAYOUT.station_mm
        direction = view.T_world_part[:3, :3] @ view.direction_part
        np.testing.assert_allclose(direction, towards / np.linalg.norm(towards), atol=2e-3)
        pixels = LAYOUT.inspection.project(
            hull @ view.T_world_part[:3, :3].T + view.T_world_part[:3, 3]
        )
        assert (pixels > 0).all()
        assert (pixels < np.array(LAYOUT.inspection.size_px)).all()


def test_what_a_view_claims_to_show_has_a_free_line_of_sight(plan: Plan) -> None:
    cos_limit = np.cos(np.radians(OPTIONS.max_incidence_deg)) - 1e-3
    for view in plan.presents:
        eye = np.linalg.inv(view.T_world_part) @ np.append(LAYOUT.inspection.position_mm, 1.0)
        points, normals = SAMPLES.points_mm[view.seen], SAMPLES.normals[view.seen]
        sight = eye[:3] - points
        sight = sight / np.linalg.norm(sight, axis=1)[:, None]
        assert (np.einsum("ij,ij->i", sight, normals) >= cos_limit).all()
        # trimesh' own slow caster on a few of them: no triangle between
        few = np.linspace(0, len(points) - 1, 12).astype(int)
        hits = RayMeshIntersector(SOLID.mesh).intersects_any(
            points[few] + 0.05 * normals[few], sight[few]
        )
        assert not hits.any()


def test_the_pads_hide_what_they_hold(plan: Plan) -> None:
    for view in plan.presents:
        hand = np.linalg.inv(view.grasp.T_part_tcp)
        at = SAMPLES.points_mm @ hand[:3, :3].T + hand[:3, 3]
        under = (at[:, 0] < -1) & (at[:, 0] > -LAYOUT.arm_gripper.pad_length_mm + 1)
        under &= np.abs(at[:, 2]) < LAYOUT.arm_gripper.finger_width_mm / 2 - 1
        under &= np.abs(np.abs(at[:, 1]) - view.grasp.opening_mm / 2) < 0.1
        assert not view.seen[under].any()


def test_one_hand_off_shows_more_than_95_percent_within_200_seconds(plan: Plan) -> None:
    assert plan.regrasp_count == 1
    assert plan.covered_fraction > 0.95
    assert plan.forecast_s < 200.0
    assert plan.forecast_s == pytest.approx(sum(s for _, s in plan.seconds_by_step))


def test_a_plan_is_forecast_for_a_good_part_however_far_another_tray_is(plan: Plan) -> None:
    far = replace(plan.place["reject"], seconds=1e3)
    farther = replace(plan, place={**plan.place, "reject": far})
    assert farther.seconds_by_step == plan.seconds_by_step
    assert plan.seconds_by_step[-2][0] == "place in tray accept"


def test_seen_and_unseen_add_up_to_the_whole_surface(plan: Plan) -> None:
    seen = np.any([v.seen for v in plan.presents], axis=0)
    weights = SAMPLES.areas_mm2 / SAMPLES.areas_mm2.sum()
    assert plan.covered_fraction == pytest.approx(weights[seen].sum())
    missing = sum(u.area_fraction for u in plan.unseen)
    assert plan.covered_fraction + missing == pytest.approx(1.0, abs=2e-3)
    assert all(u.reason for u in plan.unseen)


def test_both_flat_faces_are_shown_square(plan: Plan) -> None:
    flats = {f.id for f in SOLID.faces if f.kind == "plane" and f.area_mm2 > 1000}
    shown = {v.square_to for v in plan.presents}
    for look in (s for s in plan.steps if isinstance(s, Look)):  # the upper one, from above
        shown |= {f for f in flats if SOLID.faces[f].normal @ look.direction_part > 0.98}
    assert flats <= shown


def test_the_same_input_gives_the_same_plan(plan: Plan, prepared: PreparedPart) -> None:
    again = plan_part(
        SOLID, SAMPLES, POSE, T_START, LAYOUT, prepared=pickle.loads(pickle.dumps(prepared))
    )
    assert again.seconds_by_step == plan.seconds_by_step
    for a, b in zip(again.presents, plan.presents, strict=True):
        np.testing.assert_array_equal(a.q, b.q)
        np.testing.assert_array_equal(a.seen, b.seen)


def test_a_part_beyond_the_arm_is_refused_with_reach_and_limit(prepared: PreparedPart) -> None:
    far = resting_pose(SOLID, POSE, 900.0, 0.0, 0.0)
    with pytest.raises(OutOfReachError, match="reaches 507 mm") as error:
        plan_part(SOLID, SAMPLES, POSE, far, LAYOUT, prepared=prepared)
    assert error.value.reach_mm > error.value.limit_mm == 507.0
    assert "(900, 0)" in error.value.where


def test_a_part_under_the_column_is_refused_without_a_crash(prepared: PreparedPart) -> None:
    near = resting_pose(SOLID, POSE, -100.0, 0.0, 0.0)
    with pytest.raises(NoPlanError, match="holder on the table at \\(-100, 0\\)"):
        plan_part(SOLID, SAMPLES, POSE, near, LAYOUT, prepared=prepared)


def test_views_follow_a_measured_grip(plan: Plan) -> None:
    view: Present = plan.presents[0]
    slipped = view.grasp.T_part_tcp.copy()
    slipped[:3, 3] += 2.0 * slipped[:3, 0]  # the hand 2 mm further in: the part 2 mm further back
    moved = shown_pose(LAYOUT, view.q, slipped)
    hand_x = moved[:3, :3] @ slipped[:3, 0]
    np.testing.assert_allclose(moved[:3, 3] - view.T_world_part[:3, 3], -2.0 * hand_x, atol=1e-9)


def test_a_face_that_came_short_from_a_grasp_is_shown_from_another_one(
    plan: Plan, prepared: PreparedPart
) -> None:
    held, last = plan.grasps[-1], plan.presents[-1]
    start = InArm(held, last.q)
    faces = prepared.counted_samples.face_ids
    everything = np.ones(len(faces), dtype=bool)
    assert plan_from(prepared, LAYOUT, start, seen=everything).presents == ()
    # of a face that another grasp shows, too; turned over, a gripper is where it was
    base = held.id.removesuffix("'")
    others = [g.id.removesuffix("'") != base for g in prepared.arm_grasps]
    by_others = prepared.covered[others].any(axis=0)
    shares = {i: by_others[prepared.samples.face_ids == i].mean() for i in np.unique(faces)}
    face = max(shares, key=lambda i: (shares[i], (faces == i).sum()))
    short = frozenset({FaceToShowAgain(held.id, int(face))})
    again = plan_from(prepared, LAYOUT, start, seen=everything, short=short)
    first = next(k for k, step in enumerate(again.steps) if isinstance(step, ReceiveStep | Pick))
    showing = [isinstance(s, Present) and s.seen[faces == face].any() for s in again.steps]
    assert any(showing[first:])
    assert not any(showing[:first])
    assert again.grasps[-1].id.removesuffix("'") != base


@pytest.mark.parametrize("fingers", [(0.0, 0.0, -1.0), (0.0, -1.0, 0.0)])
def test_a_tall_block_is_put_down_on_its_side_and_not_on_its_end(
    prepared: PreparedPart, plan: Plan, fingers: tuple[float, float, float]
) -> None:
    size_mm = np.array([30.0, 40.0, 120.0])
    poses = stable_poses(make_solid(trimesh.creation.box(size_mm), "tall", "5eed" * 16, "test"))
    for pose in poses:
        up = int(np.abs(pose.R[2]).argmax())
        half_base = np.delete(size_mm, up).min() / 2
        assert pose.topple_rad == pytest.approx(np.arctan2(half_base, size_mm[up] / 2), abs=1e-3)
        assert is_steady(pose) is (up != 2)
    # fingers along the block's length come from above only where it stands on its end
    T = np.eye(4)
    T[:3, 0] = fingers
    T[:3, 1] = 1.0, 0.0, 0.0
    T[:3, 2] = np.cross(T[:3, 0], T[:3, 1])
    grasp = replace(plan.grasps[0], T_part_tcp=T)
    assert stands_steadily(replace(prepared, poses=poses), grasp) is (fingers[2] == 0.0)
