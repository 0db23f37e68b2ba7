"""A plan that begins with the view that decides what the arm gripper holds."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from planning_cell import emulated_layout
from trimesh.creation import box as make_box

from controller.cad import Solid, make_solid, sample_surface, stable_poses
from controller.imaging import inverse_pose
from controller.planning import (
    NoPlanError,
    OnTable,
    Pick,
    Plan,
    PlanOptions,
    PreparedPart,
    Present,
    TableHypothesis,
    identify,
    plan_under_ambiguity,
    prepare_part,
    resting_pose,
)

LAYOUT = emulated_layout()


def stepped(cut: tuple[float, float, float]) -> Solid:
    """A block with a corner cut out below, where the camera over the table does not see it."""
    block = make_box(extents=(60.0, 40.0, 30.0))
    notch = make_box(extents=(24.0, 14.0, 12.0))
    notch.apply_translation(np.array([cut[0] * 18.1, cut[1] * 13.1, cut[2] * 9.1]))
    return make_solid(block.difference(notch), f"notched {cut}", "5eed" * 16, "test")


@pytest.fixture(scope="module")
def left() -> PreparedPart:
    solid = stepped((1.0, 1.0, -1.0))
    return prepare_part(solid, sample_surface(solid, 5.0), LAYOUT, PlanOptions().coarse())


def pose_on_table(solid: Solid, down: tuple[float, float, float]) -> OnTable:
    pose = next(p for p in stable_poses(solid) if -p.R[2] @ np.array(down) > 0.99)
    return OnTable(pose.index, resting_pose(solid, pose, 360.0, 10.0, 0.3))


def as_hypothesis(solid: Solid, start: OnTable, of: Solid) -> TableHypothesis:
    """Another solid where the first one lies: all but the notch is the same."""
    centred = start.T_world_part @ np.array([0.0, 0.0, 0.0, 1.0])
    T = start.T_world_part.copy()
    T[:3, 3] = centred[:3]
    return TableHypothesis(of.name, of, T)


TWIN = stepped((-1.0, 1.0, -1.0))


@pytest.fixture(scope="module")
def plan(left: PreparedPart) -> Plan:
    start = pose_on_table(left.solid, (0.0, 0.0, -1.0))
    return plan_under_ambiguity(left, LAYOUT, start, [as_hypothesis(left.solid, start, TWIN)])


def test_the_view_that_tells_comes_first_and_the_rest_follows(
    left: PreparedPart, plan: Plan
) -> None:
    pick, view, *rest = plan.steps
    assert isinstance(pick, Pick)
    assert isinstance(view, Present)
    assert view.ambiguity is not None
    assert view.ambiguity.margin >= 1.0
    assert [c.solid for c in view.ambiguity.hypotheses] == [left.solid, TWIN]
    assert all(s.ambiguity is None for s in rest if isinstance(s, Present))
    assert plan.covered_fraction > 0.99


def test_the_view_that_tells_looks_at_where_they_differ(left: PreparedPart, plan: Plan) -> None:
    view = next(s for s in plan.steps if isinstance(s, Present))
    d = view.direction_part
    # both notches are open downwards and along +y: from above and behind, nothing differs
    assert d[2] < 0.0 or d[1] > 0.0
    eye = inverse_pose(view.T_world_part) @ np.append(LAYOUT.inspection.position_mm, 1.0)
    away = eye[:3] - left.solid.centroid_mm
    assert np.allclose(d, away / np.linalg.norm(away), atol=1e-6)


@pytest.mark.parametrize("truth", [0, 1])
def test_the_pictures_of_that_view_tell_which_it_is(plan: Plan, truth: int) -> None:
    view = next(s for s in plan.steps if isinstance(s, Present))
    ambiguity = view.ambiguity
    assert ambiguity is not None
    camera = LAYOUT.inspection
    tip = view.T_world_part @ view.grasp.T_part_tcp
    held = ambiguity.hypotheses[truth]
    # drawn from the triangles' corners alone: dark before a bright panel, under lamps a bright part
    T = tip @ held.T_tcp_part
    corners = np.asarray(held.solid.mesh.triangles).reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
    triangles = camera.project(corners).reshape(-1, 3, 2)
    width, height = camera.size_px
    backlit = np.full((height, width), 220, np.uint8)
    for triangle in np.round(triangles).astype(np.int32):
        cv2.fillConvexPoly(backlit, triangle, 20)
    lit = np.where(backlit < 100, 140, 30).astype(np.uint8)
    opening = view.grasp.opening_mm
    if ambiguity.light == "backlight":
        assert identify(ambiguity, LAYOUT, view.q, opening, backlit, [lit]).left == (truth,)
    else:
        assert truth in identify(ambiguity, LAYOUT, view.q, opening, backlit, [lit]).left


def test_what_no_grip_holds_both_ways_is_refused(left: PreparedPart) -> None:
    start = pose_on_table(left.solid, (0.0, 0.0, -1.0))
    large = make_solid(make_box(extents=(84.0, 84.0, 30.0)), "large", "5eed" * 16, "test")
    with pytest.raises(NoPlanError, match="no grasp from above holds both"):
        plan_under_ambiguity(left, LAYOUT, start, [as_hypothesis(left.solid, start, large)])


def test_the_same_part_read_twice_needs_no_view_to_tell(left: PreparedPart) -> None:
    start = pose_on_table(left.solid, (0.0, 0.0, -1.0))
    same = TableHypothesis(left.solid.name, left.solid, start.T_world_part)
    plan = plan_under_ambiguity(left, LAYOUT, start, [same])
    assert all(s.ambiguity is None for s in plan.steps if isinstance(s, Present))
    assert plan.covered_fraction > 0.99


def test_another_part_of_the_same_shape_is_refused_with_the_reason(left: PreparedPart) -> None:
    start = pose_on_table(left.solid, (0.0, 0.0, -1.0))
    copy = stepped((1.0, 1.0, -1.0))
    with pytest.raises(NoPlanError, match="no view distinguishes"):
        plan_under_ambiguity(left, LAYOUT, start, [as_hypothesis(left.solid, start, copy)])
