"""The planner with a UR5e: a recipe's part shown whole, in a cell laid out for that arm.

The plan is followed by the checker that follows those of the UMI, with the published matrices,
joint by joint, and exact contacts.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planning_checker import follow
from planning_contacts import ArmReading, Array, rx, rz, shift

from controller.cad.compiled import load_part
from controller.cell.compute import part_files
from controller.config import load_cell, load_recipe
from controller.planning import (
    Box,
    CellLayout,
    GiveStep,
    OnTable,
    Pick,
    Present,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.setup.planner import planner_setup
from drivers.ur_arm import UrShape, describe

RECIPES = Path(__file__).parents[2] / "recipes"
BASE_X_MM = -350.0
TOOL_MM = 177.0
QUARTER = np.pi / 2


def frames(layout: CellLayout, q: Array) -> dict[str, Array]:
    """Return the world poses (..., 4, 4) of links and tip, joint after joint (ur.md 1.1)."""
    shoulder = layout.T_world_arm @ shift(0.0, 0.0, 162.5) @ rz(q[..., 0])
    upper = shoulder @ rx(np.full(q.shape[:-1], QUARTER)) @ rz(q[..., 1])
    fore = upper @ shift(-425.0, 0.0, 0.0) @ rz(q[..., 2])
    wrist1 = fore @ shift(-392.2, 0.0, 133.3) @ rz(q[..., 3])
    wrist2 = wrist1 @ shift(0.0, -99.7, 0.0) @ rx(np.full(q.shape[:-1], QUARTER)) @ rz(q[..., 4])
    wrist3 = wrist2 @ shift(0.0, 99.6, 0.0) @ rx(np.full(q.shape[:-1], -QUARTER)) @ rz(q[..., 5])
    approach_is_x = np.eye(4)
    approach_is_x[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    tip = wrist3 @ shift(0.0, 0.0, TOOL_MM) @ approach_is_x
    return {
        "shoulder": shoulder,
        "upper": upper,
        "fore": fore,
        "wrist1": wrist1,
        "wrist2": wrist2,
        "wrist3": wrist3,
        "tip": tip,
    }


def limits_passed(q: Array) -> list[str]:
    limits = np.radians([360.0, 360.0, 180.0, 360.0, 360.0, 360.0])
    return [f"joint {k}" for k in np.flatnonzero((np.abs(q) > limits).any(axis=0))]


PAIRS = ["shoulder-fore", "shoulder-wrist1", "shoulder-wrist2", "shoulder-wrist3", "upper-wrist1"]
PAIRS += ["upper-wrist2", "upper-wrist3", "fore-wrist2", "fore-wrist3"]
UR5E = ArmReading(
    frames,
    limits_passed,
    step=np.full(6, 0.01),  # the outstretched tip moves by 12 mm
    rides=frozenset({"shoulder", "upper"}),  # the upper arm goes by beside its own base
    kept_from={"shoulder": "hand", "upper": "hand", "fore": "hand", "wrist1": "hand"}
    | {"wrist2": "fingers"},
    link_pairs=frozenset((a, b) for a, b in (pair.split("-") for pair in PAIRS)),
)


def cell_for_a_ur5e(layout: CellLayout) -> CellLayout:
    """Return the emulated cell with the arm behind the table, turned round: it works towards -x."""
    shape = UrShape("ur5e", TOOL_MM, (0.0, -110.0, 130.0, -110.0, -90.0, 0.0))
    described = describe(shape)
    T_world_arm = np.diag([-1.0, -1.0, 1.0, 1.0])
    T_world_arm[0, 3] = BASE_X_MM
    x = BASE_X_MM
    return replace(
        layout,
        arm=described.model,
        T_world_arm=T_world_arm,
        column=Box.from_bounds(x - 76.0, x + 76.0, -76.0, 76.0, 0.0, 95.0),
        park_q=described.park_q,
    )


def test_a_recipes_part_is_shown_whole_by_a_ur5e() -> None:
    recipe = load_recipe(RECIPES / "holder.yaml")
    part = load_part(*part_files(recipe)[0])
    setup = planner_setup(recipe, load_cell(RECIPES / "cells" / "emulated.yaml"), part)
    layout = cell_for_a_ur5e(setup.layout)
    prepared = prepare_part(part.solid, part.chosen_by, layout, setup.options)
    pose = max(part.poses, key=lambda p: p.probability)
    x_mm, y_mm = layout.set_down_mm.mean(axis=1).tolist()
    T = resting_pose(part.solid, pose, x_mm, y_mm)
    plan = plan_from(prepared, layout, OnTable(pose.index, T))
    kinds = [type(step) for step in plan.steps]
    assert {Pick, Present, GiveStep} <= set(kinds)
    assert set(plan.place) == set(plan.park) == set(layout.trays)
    assert plan.covered_fraction == pytest.approx(plan.reachable_fraction)
    assert plan.covered_fraction > 0.99
    assert plan.unseen == ()
    walk = follow(plan, layout, part.solid, T, UR5E)
    assert walk.trouble == []
    assert len(walk.moments) >= sum(kind is Present for kind in kinds)
