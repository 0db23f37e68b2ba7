"""The judge of plans finds what is wrong with one: each fault is put into a good plan by hand."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cad_solids import box, solid_of
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_cell import emulated_layout

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from plan_digests import digest
from planning_checker import check
from planning_contacts import (
    Checker,
    frames,
    joints_for,
    limits_passed,
    wall_along_y,
    within_limits,
)
from planning_judge import Judge
from planning_showable import Class, Showable
from planning_sight import (
    VisibilityRules,
    blocked,
    box_triangles,
    density_of,
    in_sight,
    pixels_of,
)

from controller.cad import counted_samples, sample_surface, stable_poses
from controller.imaging import Camera, RayCaster
from controller.planning import (
    Box,
    GiveStep,
    Grasp,
    Look,
    Pick,
    Place,
    Plan,
    PlanOptions,
    PreparedPart,
    Present,
    Reason,
    ReceiveStep,
    Unseen,
    plan_part,
    prepare_part,
    resting_pose,
)
from controller.planning.views import Counter

LAYOUT = emulated_layout()
TROUGH = box(90.0, 16.0, 16.0).translate((0.0, 0.0, 12.0))
SOLID = solid_of(box(70.0, 40.0, 24.0) - TROUGH, "trough")
SAMPLES = sample_surface(SOLID, 6.0)
OPTIONS = replace(PlanOptions().coarse(), arm_grasps_per_pose=4, fixed_grasps=8)
POSE = stable_poses(SOLID)[0]
T_START = resting_pose(SOLID, POSE, 350.0, 40.0, 0.7)
EYE = np.array([0.0, 0.0, 500.0])
RULES = VisibilityRules(np.radians(70.0), 1.0)
DOWN = Camera(
    (1000, 800),
    np.array([[2000.0, 0, 499.5], [0, 2000.0, 399.5], [0, 0, 1]]),
    np.zeros(5),
    np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 500], [0, 0, 0, 1]]),
)


@pytest.fixture(scope="module")
def prepared() -> PreparedPart:
    return prepare_part(SOLID, SAMPLES, LAYOUT, OPTIONS)


@pytest.fixture(scope="module")
def plan(prepared: PreparedPart) -> Plan:
    # without places on the table to change the grip at, it is the fixed gripper that helps
    passing = replace(prepared, rests=(), set_downs=())
    made = plan_part(SOLID, SAMPLES, POSE, T_START, LAYOUT, prepared=passing)
    assert any(isinstance(s, GiveStep) for s in made.steps)
    return made


@pytest.fixture(scope="module")
def judge() -> Judge:
    return Judge(SOLID, SAMPLES, LAYOUT, OPTIONS)


def changed(plan: Plan, kind: type, **values: Any) -> Plan:
    """The plan with the first step of a kind altered."""
    steps = list(plan.steps)
    k = next(k for k, s in enumerate(steps) if isinstance(s, kind))
    steps[k] = replace(steps[k], **values)
    return replace(plan, steps=tuple(steps))


def step_of(plan: Plan, kind: type) -> Any:
    return next(s for s in plan.steps if isinstance(s, kind))


# ---- sight lines ---------------------------------------------------------------------------------
def textbook(triangles: np.ndarray, eye: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Each ray and each triangle: eye + t (p - eye) = a + u (b - a) + v (c - a), solved."""
    a, b, c = (triangles[None, :, k] for k in range(3))
    d = np.broadcast_to((points - eye)[:, None], (len(points), len(triangles), 3))
    sides = [np.broadcast_to(x, d.shape) for x in (b - a, c - a)]
    right = np.broadcast_to((eye - a)[..., None], (*d.shape, 1))
    t, u, v = np.linalg.solve(np.stack([-d, *sides], axis=-1), right)[..., 0].transpose(2, 0, 1)
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9) & (t < 1)
    return np.asarray(hit.any(axis=1))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), slivers=st.booleans())
def test_sight_lines_agree_with_the_textbook_triangle_by_triangle(seed: int, slivers: bool) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-60, 60, (30, 3, 3))
    if slivers:
        triangles[:, 1] = triangles[:, 0] + 0.01 * (triangles[:, 1] - triangles[:, 0])
    points = rng.uniform(-50, 50, (40, 3))
    eye = rng.normal(size=3)
    eye *= 200.0 / np.linalg.norm(eye)
    np.testing.assert_array_equal(blocked(triangles, eye, points), textbook(triangles, eye, points))


def test_a_box_about_the_eye_hides_everything_outside_it() -> None:
    shell = box_triangles(np.eye(4), np.array([10.0, 10.0, 10.0]))
    points = np.array([[0.0, 0.0, 50.0], [3.0, 2.0, 60.0], [0.0, 0.0, 9.0]])
    assert blocked(shell, np.zeros(3), points).tolist() == [True, True, False]


def test_pixels_follow_opencv() -> None:
    camera = LAYOUT.inspection
    points = LAYOUT.station_mm + np.random.default_rng(1).uniform(-80, 80, (50, 3))
    np.testing.assert_allclose(pixels_of(camera, points), camera.project(points), atol=1e-8)


def test_pixels_per_millimetre_are_focal_length_by_depth_times_the_cosine() -> None:
    # at 500 mm under 2000 px a millimetre has 4 px; a surface turned by 60 degrees half of that
    lean = np.array([[0.0, 0.0, 1.0], [np.sin(np.pi / 3), 0.0, 0.5]])
    found = density_of(DOWN, np.zeros((2, 3)), lean)
    np.testing.assert_allclose(found, [4.0, 2.0], rtol=1e-5)


def test_each_rule_of_sight_is_asked() -> None:
    p, n = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    nothing = np.zeros((0, 3, 3))

    def sees(
        points: np.ndarray = p,
        normals: np.ndarray = n,
        wall: np.ndarray = nothing,
        rules: VisibilityRules = RULES,
    ) -> bool:
        return bool(in_sight(points, normals, DOWN, wall, rules).seen[0])

    assert sees()
    assert not sees(normals=np.array([[np.sin(1.3), 0.0, np.cos(1.3)]]))  # 74 degrees
    assert sees(normals=np.array([[np.sin(1.2), 0.0, np.cos(1.2)]]))  # 69 degrees
    assert not sees(wall=box_triangles(np.eye(4), np.array([1.0, 1.0, 50.0])))
    assert not sees(rules=replace(RULES, min_px_per_mm=4.1))
    assert not sees(rules=replace(RULES, sharp_mm=(510.0, 600.0)))
    assert not sees(rules=replace(RULES, sharp_mm=(400.0, 490.0)))
    assert not sees(points=np.array([[126.0, 0.0, 0.0]]))  # 504 px from the middle of 1000
    assert sees(points=np.array([[124.0, 0.0, 0.0]]))


def test_what_hangs_on_a_third_of_a_millimetre_is_left_open() -> None:
    # a plate whose rim hides what lies left of x = 0, half-way up to the camera
    T = np.eye(4)
    T[:3, 3] = -50.0, 0.0, 250.0
    plate = box_triangles(T, np.array([50.0, 50.0, 1e-6]))
    x = np.array([-5.0, -0.4, -0.2, 0.2, 0.4, 5.0])
    points = np.column_stack([x, np.zeros(6), np.zeros(6)])
    up = np.tile([0.0, 0.0, 1.0], (6, 1))
    every = in_sight(points, up, DOWN, plate, RULES, np.ones(6, bool))
    none = in_sight(points, up, DOWN, plate, RULES, np.zeros(6, bool))
    assert every.seen.tolist() == none.seen.tolist() == [False] * 3 + [True] * 3
    assert every.open.tolist() == [False, False, True, False, False, False]
    assert none.open.tolist() == [False, False, False, True, False, False]


# ---- arm and grips -------------------------------------------------------------------------------
@settings(max_examples=30, deadline=None)
@given(
    share=st.tuples(*[st.floats(0.02, 0.98)] * 6),
)
def test_joints_are_found_again_from_where_they_bring_the_hand(share: tuple[float, ...]) -> None:
    low = np.array([-90.0, -180.0, -90.0, -880.0, -97.0, -131.0])
    high = np.array([90.0, 150.0, 90.0, -6.0, 3.0, 180.0])
    q = low + np.array(share) * (high - low)
    q[2] += q[1] / 2
    q[[0, 1, 2, 4, 5]] = np.radians(q[[0, 1, 2, 4, 5]])
    assert within_limits(q[None]).all()
    T = frames(LAYOUT, q[None])["tip"]
    index, rows = joints_for(LAYOUT, T)
    back = frames(LAYOUT, rows)["tip"]
    np.testing.assert_allclose(back, T[index], atol=1e-6)
    # where the hand points straight down, one of its headings is as good as any other
    assert np.abs(rows - q).max(axis=1).min() < 1e-5 or abs(np.degrees(q[4]) + 90) < 1e-3


def test_limits_are_the_papers() -> None:
    # umi_rtx.md 5.2 in degrees: shoulder 90, elbow -180..151, hand 110 to the forearm, pitch 4
    q = np.zeros(6)
    q[3] = -100.0
    assert limits_passed(q[None]) == []
    for joint, passed, name in (
        (0, 91.0, "shoulder"),
        (1, 152.0, "elbow"),
        (2, 111.0, "yaw"),
        (4, 4.5, "pitch"),
        (4, -98.5, "pitch"),
        (5, -133.0, "roll"),
    ):
        bad = q.copy()
        bad[joint] = np.radians(passed)
        bad[2] += bad[1] / 2  # the hand keeps to the forearm
        (found,) = limits_passed(bad[None])
        assert found.startswith(name)


def test_walls_are_met_where_they_stand() -> None:
    cube = box_triangles(np.eye(4), np.array([20.0, 7.5, 20.0]))
    x, z = np.array([0.0, 3.0, 30.0]), np.array([0.0, -4.0, 0.0])
    np.testing.assert_allclose(wall_along_y(cube, x, z, 30.0, outwards=False), [7.5, 7.5])
    np.testing.assert_allclose(wall_along_y(cube, x, z, 0.0, outwards=True), [7.5, 7.5])


def test_the_fastest_contact_test_is_the_slow_one() -> None:
    c = Checker(LAYOUT, SOLID)
    rng = np.random.default_rng(3)
    low = np.array([-1.5, -2.0, -1.5, -850.0, -1.6, -2.0])
    q = low + rng.random((60, 6)) * np.array([3.0, 4.0, 3.0, 800.0, 1.6, 4.0])
    T = np.eye(4)
    T[:3, 3] = 330.0, 20.0, 200.0
    free = c.free(q, 40.0, 80.0, T, (), 0.0)
    one_by_one = [not c.contacts(row[None], 40.0, 80.0, T, ()) for row in q]
    assert free.tolist() == one_by_one
    assert 5 < free.sum() < 55


# ---- plans ---------------------------------------------------------------------------------------
def test_a_good_plan_is_sound(plan: Plan, judge: Judge, prepared: PreparedPart) -> None:
    verdict = judge.judge(plan, T_START, prepared.arm_grasps[:6])
    assert verdict.trouble == []
    assert verdict.false_claims == 0
    assert verdict.covered == pytest.approx(plan.covered_fraction)
    said = [s.seen for s in plan.steps if isinstance(s, Present | Look)]
    assert verdict.claims == np.sum(said)
    assert verdict.floor_regrips == 1  # every pair of pads hides part of a closed surface
    assert verdict.cpu_s < 10.0


def test_a_view_that_claims_everything_is_found_out(plan: Plan, judge: Judge) -> None:
    view = plan.presents[0]
    bad = changed(plan, Present, seen=np.ones_like(view.seen))
    verdict = judge.judge(bad, T_START)
    assert verdict.false_claims > 0.3 * len(view.seen)
    assert verdict.falsely_covered == pytest.approx(1.0 - verdict.covered)
    assert not verdict.is_sound


def test_a_view_that_claims_less_than_it_shows_is_counted(plan: Plan, judge: Judge) -> None:
    bad = changed(plan, Present, seen=np.zeros_like(plan.presents[0].seen))
    few = judge.judge(plan, T_START).missed_claims
    more = judge.judge(bad, T_START).missed_claims
    assert more > few + 0.9 * plan.presents[0].seen.sum()


def test_a_covered_fraction_that_is_not_the_views_own_is_found_out(
    plan: Plan, judge: Judge
) -> None:
    bad = replace(plan, covered_fraction=1.0 - 1e-3 * (plan.covered_fraction == 1.0))
    assert any("the plan says it covers" in t for t in judge.judge(bad, T_START).trouble)


def test_surface_without_a_reason_is_found_out(plan: Plan, judge: Judge) -> None:
    # one view less, and nobody says why: that which alone shows the most
    weights = SAMPLES.areas_mm2 / SAMPLES.areas_mm2.sum()
    views = [s for s in plan.steps if isinstance(s, Present | Look)]
    alone = {
        v.view_id: weights[v.seen & ~np.any([o.seen for o in views if o is not v], axis=0)].sum()
        for v in plan.presents
    }
    last = max(plan.presents, key=lambda v: alone[v.view_id])
    assert alone[last.view_id] > 0.01
    others = np.any([v.seen for v in views if v is not last], axis=0)
    k = next(k for k, s in enumerate(plan.steps) if s is last)
    bad = replace(
        plan,
        steps=(*plan.steps[:k], replace(last, seen=np.zeros_like(last.seen)), *plan.steps[k + 1 :]),
        covered_fraction=float(weights[others].sum()),
    )
    assert any("reasons are given for" in t for t in judge.judge(bad, T_START).trouble)


def test_a_wrong_reason_is_found_out(plan: Plan, judge: Judge, prepared: PreparedPart) -> None:
    # all that the first views show is said to be hidden by the part itself
    seen = plan.presents[0].seen
    weights = SAMPLES.areas_mm2 / SAMPLES.areas_mm2.sum()
    face = int(np.bincount(SAMPLES.face_ids[seen], weights[seen]).argmax())
    mine = SAMPLES.face_ids == face
    kinds = Present | Look
    steps = [replace(s, seen=s.seen & ~mine) if isinstance(s, kinds) else s for s in plan.steps]
    shown = np.any([s.seen for s in steps if isinstance(s, kinds)], axis=0)
    covered = float(weights[shown].sum())
    which = tuple(np.flatnonzero(mine).tolist())
    lie = Unseen(face, float(weights[mine].sum()), "no", Reason.HIDDEN_BY_PART, samples=which)
    others = tuple(u for u in plan.unseen if u.face_id != face)
    bad = replace(plan, steps=tuple(steps), covered_fraction=covered, unseen=(lie, *others))
    verdict = judge.judge(bad, T_START, prepared.arm_grasps)
    assert verdict.wrong_kinds > 0.5 * weights[mine].sum()
    assert verdict.showable_unseen > 0.5 * weights[mine].sum()
    for found in verdict.evidence[:3]:  # each view found is one: shown again with all margins
        grasp = next(g for g in prepared.arm_grasps if g.id == found.grip_id)
        T = frames(LAYOUT, found.q)["tip"] @ np.linalg.inv(grasp.T_part_tcp)
        assert judge.search.truly(found.q, T, grasp, np.array([found.sample])).all()


def shifted(grasp: Grasp, along: int, mm: float) -> Grasp:
    T = grasp.T_part_tcp.copy()
    T[:3, 3] += mm * T[:3, along]
    return replace(grasp, T_part_tcp=T)


def test_a_grip_beside_the_walls_is_found_out(plan: Plan) -> None:
    grasp = step_of(plan, Pick).grasp
    c = Checker(LAYOUT, SOLID)

    def said(changed: Grasp) -> str:
        return "; ".join(c.hold(changed, LAYOUT.arm_gripper, "pick"))

    assert said(grasp) == ""
    assert "is to stop at" in said(replace(grasp, opening_mm=grasp.opening_mm + 2.0))
    # 60 mm out of the part the pads touch nothing
    assert "touches 0 mm2" in said(shifted(grasp, 0, -60.0))
    # closed 4 mm further than the walls allow, the fingers stand inside the part
    assert "inside the part" in said(replace(grasp, opening_mm=grasp.opening_mm - 4.0))
    assert "wider than the jaw" in said(replace(grasp, pre_open_mm=99.0))


def test_steps_out_of_order_are_found_out(plan: Plan) -> None:
    k = next(k for k, s in enumerate(plan.steps) if isinstance(s, GiveStep))
    without = replace(plan, steps=(*plan.steps[:k], *plan.steps[k + 1 :]))
    assert any(
        "needs the part with the fixture" in t for t in check(without, LAYOUT, SOLID, T_START)
    )
    twice = replace(plan, steps=(step_of(plan, Pick), *plan.steps))
    assert any("needs the part with the table" in t for t in check(twice, LAYOUT, SOLID, T_START))


def test_both_grippers_open_at_once_are_found_out(plan: Plan) -> None:
    over = step_of(plan, GiveStep)
    loose = replace(over.fixed_grasp, opening_mm=over.fixed_grasp.opening_mm + 5.0)
    bad = changed(plan, GiveStep, fixed_grasp=loose)
    assert any("is to stop at" in t for t in check(bad, LAYOUT, SOLID, T_START))


def test_a_part_that_jumps_between_hands_is_found_out(plan: Plan) -> None:
    back = step_of(plan, ReceiveStep)
    bad = changed(plan, ReceiveStep, grasp=shifted(back.grasp, 2, 3.0))
    found = check(bad, LAYOUT, SOLID, T_START)
    assert any("3.00 mm" in t and "off its grip" in t for t in found)


def test_a_box_in_the_way_is_found_out(plan: Plan) -> None:
    # a post where the arm lifts the part
    tip = frames(LAYOUT, step_of(plan, Pick).motion_up[-1])["tip"][:3, 3]
    x, y, z = tip
    post = Box.from_bounds(x - 5, x + 5, y - 5, y + 5, z - 5, z + 300)
    layout = replace(LAYOUT, obstacles={**LAYOUT.obstacles, "new post": post})
    assert any("new post" in t for t in check(plan, layout, SOLID, T_START))


def test_a_thin_wire_across_the_way_is_met_between_the_waypoints(plan: Plan) -> None:
    view = plan.presents[0]
    k = next(k for k, s in enumerate(plan.steps) if s is view)
    pick = step_of(plan, Pick)
    assert plan.steps[k - 1] is pick
    for a, b in pairwise([pick.motion_up[-1], *view.motion]):
        mid = frames(LAYOUT, (a + b) / 2)["fore"] @ LAYOUT.arm.links[2].T
        wire = Box(mid, np.array([1.0, 60.0, 1.0]))
        layout = replace(LAYOUT, obstacles={**LAYOUT.obstacles, "wire": wire})
        if np.abs(b - a).max() > 0.3:
            assert any("wire" in t for t in check(plan, layout, SOLID, T_START))
            return
    pytest.fail("no motion long enough")


def test_a_waypoint_beyond_a_joints_end_is_found_out(plan: Plan) -> None:
    pick = step_of(plan, Pick)
    q = pick.motion_up[-1].copy()
    q[4] = np.radians(10.0)
    bad = changed(plan, Pick, motion_up=(*pick.motion_up, q))
    assert any("pitch" in t for t in check(bad, LAYOUT, SOLID, T_START))


def test_a_part_let_go_beside_its_tray_is_found_out(plan: Plan) -> None:
    name, place = next(iter(plan.place.items()))
    tray = LAYOUT.trays[name]
    away = replace(tray, centre_mm=(tray.centre_mm[0] + 200.0, tray.centre_mm[1]))
    layout = replace(LAYOUT, trays={**LAYOUT.trays, name: away})
    assert any("not over the tray" in t for t in check(plan, layout, SOLID, T_START))
    upright = replace(place, tilt_rad=0.0, T_world_part=place.T_world_part)
    lies = replace(plan, place={**plan.place, name: upright})
    said = [t for t in check(lies, LAYOUT, SOLID, T_START) if "said to lie flat" in t]
    assert bool(said) == (place.tilt_rad > 0)


def test_a_digest_tells_plans_apart_by_their_last_bit(plan: Plan) -> None:
    view = plan.presents[0]
    assert digest(changed(plan, Present, q=view.q.copy())) == digest(plan)
    other = view.q.copy()
    other[3] = np.nextafter(other[3], 0.0)
    assert digest(changed(plan, Present, q=other)) != digest(plan)
    assert digest(replace(plan, unseen=(*plan.unseen, "one more"))) != digest(plan)


# ---- the search ----------------------------------------------------------------------------------
def test_the_search_says_what_stands_between_a_sample_and_the_camera(
    judge: Judge, prepared: PreparedPart
) -> None:
    # under a pad nothing shows with that grip, whatever the arm does
    grasp = prepared.arm_grasps[0]
    (under,) = np.nonzero(judge.under_pads(grasp, LAYOUT.arm_gripper))
    classes, evidence = judge.search.classify(under.tolist(), [grasp])
    assert len(under) > 0
    assert set(classes) == {Class.FINGERS}
    assert evidence == []
    # nor is anything shown at a station beyond the arm
    away = replace(LAYOUT, station_mm=np.array([350.0, 900.0, 450.0]))
    (open_,) = np.nonzero(prepared.visible.any(axis=0))
    search = Showable(away, SOLID, SAMPLES, judge.at_station, 60)
    classes, _ = search.classify(open_[:5].tolist(), [grasp])
    assert set(classes) <= {Class.REACH, Class.FINGERS}
    assert Class.REACH in classes


def test_a_place_step_needs_the_part_in_the_hand(plan: Plan) -> None:
    k = next(k for k, s in enumerate(plan.steps) if isinstance(s, ReceiveStep))
    cut = replace(plan, steps=plan.steps[:k])
    found = check(cut, LAYOUT, SOLID, T_START)
    assert any("needs the part with the arm, the fixture has it" in t for t in found)
    assert all(isinstance(p, Place) for p in plan.place.values())


def test_a_plan_counted_by_other_points_than_it_was_chosen_by_states_what_is_true_of_them() -> None:
    counted = counted_samples(SOLID, 3.0)
    prepared = prepare_part(SOLID, SAMPLES, LAYOUT, OPTIONS, counted)
    made = plan_part(SOLID, SAMPLES, POSE, T_START, LAYOUT, prepared=prepared)
    verdict = Judge(SOLID, counted, LAYOUT, OPTIONS).judge(made, T_START)
    assert verdict.is_sound, verdict
    assert verdict.claims > 1000
    assert verdict.covered == pytest.approx(made.covered_fraction, abs=0.005)
    assert made.covered_fraction <= made.reachable_fraction
    # in every bit the points are others than those the views were chosen by
    chosen_by = {tuple(p) for p in prepared.samples.points_mm.tolist()}
    assert not chosen_by & {tuple(p) for p in counted.points_mm.tolist()}


def test_what_the_table_camera_shows_of_the_counted_points_is_what_an_exact_caster_sees() -> None:
    samples = counted_samples(SOLID, 2.5)
    counter = Counter(SOLID, samples, LAYOUT, OPTIONS, RayCaster(SOLID.mesh))
    shown = counter.on_table(T_START)
    R, t = T_START[:3, :3], T_START[:3, 3]
    exact = in_sight(
        samples.points_mm @ R.T + t,
        samples.normals @ R.T,
        LAYOUT.overhead,
        np.asarray(SOLID.mesh.triangles) @ R.T + t,
        VisibilityRules(
            np.radians(OPTIONS.max_incidence_deg), OPTIONS.min_px_per_mm, LAYOUT.overhead_sharp_mm
        ),
        shown,
    )
    assert shown.any()
    assert not shown.all()
    assert not ((shown != exact.seen) & ~exact.open).any()
