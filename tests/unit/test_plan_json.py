"""A plan as JSON where the part is set down on the table to be regrasped: no fixed gripper."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from cad_solids import box, solid_of
from plan_auditor import audit
from planning_cell import emulated_layout

from controller.cad import sample_surface
from controller.cli.planning.plan_json import plan_json
from controller.planning import (
    GraspRules,
    OnTable,
    PlanOptions,
    SetDown,
    plan_from,
    prepare_part,
    resting_pose,
)

FEW = PlanOptions(
    arm_grasps_per_pose=3,
    arm_grasps_round=4,
    direction_count=30,
    is_coarse=True,
    rules=GraspRules().coarse(),
)


@pytest.fixture(scope="module")
def plan() -> dict[str, Any]:
    solid = solid_of(box(50, 30, 20), "block")
    samples = sample_surface(solid)
    layout = replace(emulated_layout(), fixed_gripper=None)
    part = prepare_part(solid, samples, layout, FEW)
    start = OnTable(0, resting_pose(solid, part.poses[0], 360.0, 0.0, 0.0))
    made = plan_from(part, layout, start)
    assert any(isinstance(step, SetDown) for step in made.steps)
    body = json.loads(json.dumps(plan_json(solid, samples, layout, made, {1: "gauged by hand"})))
    assert isinstance(body, dict)
    return body


def test_a_plan_that_sets_the_part_down_stands_an_audit(plan: dict[str, Any]) -> None:
    assert audit(plan) == []
    kinds = [step["kind"] for step in plan["steps"]]
    down = plan["steps"][kinds.index("set_down")]
    assert down["custody"] == {"before": "in_arm", "after": "on_table"}
    again = plan["steps"][kinds.index("set_down") + 1]
    assert again["custody"] == {"before": "on_table", "after": "in_arm"}
    assert plan["grippers"]["fixture"] is None
    assert plan["not_inspected"] == {"1": "gauged by hand"}


def test_the_arm_stands_still_while_jaws_move_and_goes_on_from_there(plan: dict[str, Any]) -> None:
    """Jaws close where the step says that they do, and the arm lifts from that very place."""
    for step in plan["steps"]:
        names = [action["action"] for action in step["actions"]]
        if step["kind"] != "pick":
            continue
        close = names.index("close")
        before, after = step["actions"][close - 1], step["actions"][close + 1]
        assert before["waypoints"][-1]["q"] == step["q"]
        lifted = after["waypoints"][-1]["q"]
        assert lifted != step["q"]
        assert after["waypoints"][-1]["seconds"] > 0
