"""Views for what the first choice leaves blind: what they add, what they cost, who counts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cad_solids import box, rod, solid_of
from planning_cell import emulated_layout

from controller.arrays import FloatArray
from controller.cad import (
    SurfaceSamples,
    counted_samples,
    face_shares,
    sample_surface,
    share_of,
    stable_poses,
)
from controller.imaging import RayCaster
from controller.planning import (
    Look,
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    Present,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.model import NoMotionError
from controller.planning.planner import planner, second_choice
from controller.planning.planner.build import Build, Builder, RefutedError
from controller.planning.planner.costs import EdgeCosts, view_seconds, worthwhile
from controller.planning.search import GraspSequence, Problem, solve
from controller.planning.views import Counter, most_worth

LAYOUT = emulated_layout()
OPTIONS = PlanOptions(direction_count=50, arm_grasps_per_pose=4, arm_grasps_round=6, fixed_grasps=6)
# two bores off the middle, one of them deep, and a pocket: none of them shown by a view or two
SOLID = solid_of(
    box(56, 40, 18)
    - rod(4.0, 40, 64).translate((-16, 6, 0))
    - rod(6.5, 40, 64).translate((17, -7, 0))
    - box(12, 9, 20).translate((2, 11, 12)),
    "bored",
)
# few samples, so that the first choice leaves much between them
CHOSEN_BY = sample_surface(SOLID, 12.0, 2)
COUNTED = counted_samples(SOLID, 1.2)
POSE = stable_poses(SOLID)[0]
START = OnTable(POSE.index, resting_pose(SOLID, POSE, 350.0, 40.0, 0.4))


def prepared_with(counted: SurfaceSamples) -> PreparedPart:
    return prepare_part(SOLID, CHOSEN_BY, LAYOUT, OPTIONS, counted)


@pytest.fixture(scope="module")
def prepared() -> PreparedPart:
    return prepared_with(COUNTED)


@pytest.fixture(scope="module")
def plan(prepared: PreparedPart) -> Plan:
    return plan_from(prepared, LAYOUT, START)


def first_choice_alone(prepared: PreparedPart) -> Plan:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            second_choice.SecondChoice, "added_to", lambda self, problem, solution: solution
        )
        return plan_from(prepared, LAYOUT, START)


def views_of(plan: Plan) -> list[tuple[str, str]]:
    return [(s.grasp.id, s.view_id) for s in plan.steps if isinstance(s, Present)]


def seen_of(plan: Plan, points: SurfaceSamples) -> np.ndarray:
    """Return which points of a draw of their own the steps of a plan show."""
    counter = Counter(SOLID, points, LAYOUT, OPTIONS, RayCaster(SOLID.mesh))
    seen = np.zeros(len(points.points_mm), dtype=bool)
    for step in plan.steps:
        if isinstance(step, Present):
            seen |= counter.held_up(step.grasp, step.q)
        elif isinstance(step, Look):
            seen |= counter.on_table(step.T_world_part)
    return seen


def test_what_the_first_choice_leaves_blind_further_views_show(
    prepared: PreparedPart, plan: Plan
) -> None:
    first = first_choice_alone(prepared)
    others = counted_samples(SOLID, 1.0, 6)  # points that neither choice has met
    before, after = seen_of(first, others), seen_of(plan, others)
    assert share_of(others, before) < share_of(others, after)
    # no face has lost, and what some view under these grasps can show is shown but for one percent
    count = len(SOLID.faces)
    had, has = (face_shares(others, seen, count)[0] for seen in (before, after))
    assert (has >= had - 0.01).all()
    assert (has - had).max() > 0.02
    assert {g for g, _ in views_of(plan)} == {g for g, _ in views_of(first)}
    counter = Counter(SOLID, others, LAYOUT, OPTIONS, RayCaster(SOLID.mesh))
    used = {s.grasp.id for s in plan.steps if isinstance(s, Present)}
    able = after.copy()
    for k, grasp in enumerate(prepared.arm_grasps):
        if grasp.id in used:
            for q in prepared.view_q[k].values():
                able |= counter.held_up(grasp, q[0])
    could, _ = face_shares(others, able, count)
    assert (could - has).max() < 0.05
    assert (could - has).mean() < 0.01


def test_the_points_that_count_choose_nothing(plan: Plan) -> None:
    others = counted_samples(SOLID, 1.2, 9)
    again = plan_from(prepared_with(others), LAYOUT, START)
    assert views_of(again) == views_of(plan)
    assert again.covered_fraction == pytest.approx(plan.covered_fraction, abs=0.003)


def test_stated_coverage_is_that_of_points_that_nothing_was_chosen_by(plan: Plan) -> None:
    others = counted_samples(SOLID, 0.8, 7)
    true, _ = face_shares(others, seen_of(plan, others), len(SOLID.faces))
    shown = np.zeros(len(COUNTED.points_mm), dtype=bool)
    for step in plan.steps:
        if isinstance(step, Present | Look):
            shown |= step.seen
    stated, _ = face_shares(COUNTED, shown, len(SOLID.faces))
    assert np.abs(stated - true).max() < 0.005


def test_all_that_the_search_was_to_show_is_still_shown(prepared: PreparedPart, plan: Plan) -> None:
    shown = np.zeros(len(prepared.samples.points_mm), dtype=bool)
    index = {g.id: k for k, g in enumerate(prepared.arm_grasps)}
    for grasp, view in views_of(plan):
        shown |= prepared.shown[index[grasp]][int(view.rsplit("-V", 1)[1])]
    first = first_choice_alone(prepared)
    for grasp, view in views_of(first):
        assert not (prepared.shown[index[grasp]][int(view.rsplit("-V", 1)[1])] & ~shown).any()


def test_the_bound_stands_and_the_gap_is_what_the_further_views_cost(
    prepared: PreparedPart, plan: Plan
) -> None:
    first = first_choice_alone(prepared)
    more = len(views_of(plan)) - len(views_of(first))
    assert more > 0
    assert plan.proof.bound_s == pytest.approx(first.proof.bound_s)
    each_s = (plan.proof.cost_s - first.proof.cost_s) / more
    assert 1.0 < each_s < 20.0
    assert f"{more} view" in plan.proof.scope
    assert "more for spots between the samples" in plan.proof.scope


def test_a_view_that_adds_less_than_the_recipe_asks_is_not_taken(prepared: PreparedPart) -> None:
    frugal = replace(prepared, options=replace(OPTIONS, least_gain=0.1))
    assert views_of(plan_from(frugal, LAYOUT, START)) == views_of(first_choice_alone(frugal))


def test_a_further_view_without_a_path_is_left_and_the_search_not_repeated(
    prepared: PreparedPart, plan: Plan
) -> None:
    first = views_of(first_choice_alone(prepared))
    grasp_id, view_id = next(pair for pair in views_of(plan) if pair not in first)
    refused = int(view_id.rsplit("-V", 1)[1])
    show, solve = Builder.show, planner.solve
    solved: list[object] = []

    def without(
        self: Builder, build: Build, g: int, views: Sequence[int], end: FloatArray | None
    ) -> None:
        if refused in views and prepared.arm_grasps[g].id == grasp_id:
            raise RefutedError(NoMotionError("no path"), views=[(g, refused)])
        show(self, build, g, views, end)

    def counting(problem: Problem, **how: Any) -> GraspSequence | None:
        solved.append(problem)
        return solve(problem, **how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner, "solve", counting)
        plan_from(prepared, LAYOUT, START)
        usual = len(solved)
        patch.setattr(Builder, "show", without)
        found = plan_from(prepared, LAYOUT, START)
    assert (grasp_id, view_id) not in views_of(found)
    assert found.covered_fraction > plan.covered_fraction - 0.02
    assert len(solved) == 2 * usual


def test_of_several_rows_the_one_that_adds_most_comes_first_down_to_what_is_worth_a_view() -> None:
    shows = np.array([[1, 1, 0, 0], [0, 1, 1, 1], [1, 0, 0, 0], [0, 0, 0, 1]], dtype=bool)
    worth = np.array([0.6, 0.5, 0.7, 0.2])
    # the second adds 1.4, then the first 0.6 of its 1.1: less than one
    assert most_worth(shows, worth) == [1]
    assert most_worth(shows, 2 * worth) == [1, 0]
    assert most_worth(np.zeros((0, 4), dtype=bool), worth) == []


def costs_of(
    prepared: PreparedPart, second: np.ndarray, regrasp_s: float
) -> tuple[EdgeCosts, GraspSequence]:
    """Return costs of two grasps, each with one view, of which the second shows some samples."""
    count, bores = len(prepared.samples.points_mm), len(prepared.openings.faces)
    closed = np.zeros((1, bores), dtype=bool)
    both = np.full((2, 2), regrasp_s)
    np.fill_diagonal(both, np.inf)
    usual = np.array([view_seconds(LAYOUT)])
    problem = Problem(
        shows=(np.hstack([~second[None], closed]), np.hstack([second[None], closed])),
        weights=np.concatenate([prepared.weights, np.zeros(bores)]),
        view_s=(usual, usual),
        first_s=np.array([10.0, np.inf]),
        regrasp_s=both,
        last_s=np.full(2, 10.0),
        seen=np.zeros(count + bores, dtype=bool),
    )
    rows = (np.zeros(1, dtype=np.int64),) * 2
    costs = EdgeCosts(problem, rows, np.zeros(0, dtype=np.int64), (), np.zeros((0, 2, 2)))
    found = solve(problem)
    assert found is not None
    assert found.grasps == (0, 1)
    return costs, found


@pytest.mark.parametrize(("regrasp_s", "is_kept"), [(5.0, True), (60.0, False)])
def test_a_regrasp_is_worth_its_seconds_as_a_view_is(
    prepared: PreparedPart, regrasp_s: float, is_kept: bool
) -> None:
    # a tenth of the largest face, where a view of usual length has to add a fifth of that
    samples = prepared.samples
    largest = np.argmax(np.bincount(samples.face_ids, samples.areas_mm2))
    (some,) = np.nonzero(samples.face_ids == largest)
    second = np.zeros(len(samples.points_mm), dtype=bool)
    second[some[: len(some) // 10 + 1]] = True
    share = float(prepared.weights[second].sum())
    asked = replace(prepared, options=replace(OPTIONS, least_gain=share / 5))
    costs, solution = costs_of(prepared, second, regrasp_s)
    kept = worthwhile(costs, asked, LAYOUT, solution)[: len(second)]
    assert kept[~second].all()
    assert kept[second].all() == is_kept


def test_the_face_without_which_no_part_passes_is_worth_any_regrasp(prepared: PreparedPart) -> None:
    samples = prepared.samples
    areas = np.bincount(samples.face_ids, samples.areas_mm2)
    second = samples.face_ids == np.argmin(np.where(areas > 0, areas, np.inf))
    asked = replace(prepared, options=replace(OPTIONS, least_gain=0.1))
    costs, solution = costs_of(prepared, second, 60.0)
    assert worthwhile(costs, asked, LAYOUT, solution)[: len(second)].all()
