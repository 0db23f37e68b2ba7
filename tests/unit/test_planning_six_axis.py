"""The planner with another arm: six revolute joints in a cell laid out for them.

Nothing of planning is told which arm it is. The plans are followed by the checker that follows
those of the UMI, with a chain of joints of its own and exact contacts.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planning_checker import follow
from planning_contacts import ArmReading, Array, rx, ry, rz, shift

from controller.cad.compiled import load_part
from controller.cell.compute import part_files
from controller.cli.project.starter.drivers.arm.model import HIGH_RAD, LOW_RAD, NAMES, SixAxis
from controller.config import load_cell, load_recipe
from controller.planning import (
    Box,
    CellLayout,
    GiveStep,
    OnTable,
    OutOfReachError,
    Pick,
    PlanOptions,
    Present,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.motion import Scene, connect, inverse_rows, path_free, tcp_pose
from controller.setup.planner import planner_setup

RECIPES = Path(__file__).parents[2] / "recipes"
BASE_X_MM = -120.0


def frames(layout: CellLayout, q: Array) -> dict[str, Array]:
    """Return the world poses (..., 4, 4) of links and tip, joint after joint."""
    turret = layout.T_world_arm @ shift(0.0, 0.0, 430.0) @ rz(q[..., 0])
    upper = turret @ shift(60.0, 0.0, 0.0) @ ry(-q[..., 1])
    fore = upper @ shift(420.0, 0.0, 0.0) @ ry(-q[..., 2])
    wrist = fore @ shift(390.0, 0.0, 0.0) @ rx(q[..., 3]) @ ry(q[..., 4])
    tip = wrist @ rx(q[..., 5]) @ shift(177.0, 0.0, 0.0)
    return {"turret": turret, "upper": upper, "fore": fore, "wrist": wrist, "tip": tip}


def limits_passed(q: Array) -> list[str]:
    passed = ((q < LOW_RAD - 1e-9) | (q > HIGH_RAD + 1e-9)).any(axis=0)
    return [
        f"{name} beyond its range"
        for name, is_beyond in zip(NAMES, passed, strict=True)
        if is_beyond
    ]


SIX_AXIS = ArmReading(
    frames,
    limits_passed,
    step=np.full(6, 0.01),  # the outstretched tip moves by less than 11 mm
    rides=frozenset({"turret", "upper"}),
    kept_from={"turret": "hand", "upper": "hand", "fore": "fingers"},
    link_pairs=frozenset({("turret", "fore"), ("turret", "wrist"), ("upper", "wrist")}),
)


def cell_for_six_axes(layout: CellLayout) -> CellLayout:
    """Return the emulated cell with the other arm on a pedestal, farther back than the UMI."""
    T_world_arm = np.eye(4)
    T_world_arm[0, 3] = BASE_X_MM
    return replace(
        layout,
        arm=SixAxis(),
        T_world_arm=T_world_arm,
        column=Box.from_bounds(BASE_X_MM - 90.0, BASE_X_MM + 90.0, -90.0, 90.0, 0.0, 310.0),
        park_q=np.radians([0.0, 110.0, -110.0, 0.0, 90.0, 0.0]),
    )


@pytest.mark.parametrize("name", ["holder", "idler_riser"])
def test_a_recipes_part_is_shown_whole_by_an_arm_that_planning_does_not_know(name: str) -> None:
    recipe = load_recipe(RECIPES / f"{name}.yaml")
    part = load_part(*part_files(recipe)[0])
    setup = planner_setup(recipe, load_cell(RECIPES / "cells" / "emulated.yaml"), part)
    layout = cell_for_six_axes(setup.layout)
    prepared = prepare_part(part.solid, part.chosen_by, layout, setup.options)
    pose = max(part.poses, key=lambda p: p.probability)
    x_mm, y_mm = layout.set_down_mm.mean(axis=1).tolist()
    T = resting_pose(part.solid, pose, x_mm, y_mm)
    plan = plan_from(prepared, layout, OnTable(pose.index, T))
    # complete: from the table over a change of grasp to every tray, and no surface left out
    kinds = [type(step) for step in plan.steps]
    assert {Pick, Present, GiveStep} <= set(kinds)
    assert set(plan.place) == set(plan.park) == set(layout.trays)
    assert plan.covered_fraction == pytest.approx(plan.reachable_fraction)
    assert plan.covered_fraction > 0.99
    assert plan.covered_fraction >= recipe.inspection.min_coverage
    assert plan.unseen == ()
    walk = follow(plan, layout, part.solid, T, SIX_AXIS)
    assert walk.trouble == []
    assert len(walk.moments) >= sum(kind is Present for kind in kinds)


@pytest.fixture(scope="module")
def layout() -> CellLayout:
    recipe = load_recipe(RECIPES / "holder.yaml")
    part = load_part(*part_files(recipe)[0])
    cell = load_cell(RECIPES / "cells" / "emulated.yaml")
    return cell_for_six_axes(planner_setup(recipe, cell, part).layout)


def test_tip_and_inverse_are_in_the_world_and_not_in_the_arms_frame(layout: CellLayout) -> None:
    rng = np.random.default_rng(3)
    q = LOW_RAD + rng.random((100, 6)) * (HIGH_RAD - LOW_RAD)
    tips = tcp_pose(layout, q)
    np.testing.assert_allclose(tips, frames(layout, q)["tip"], atol=1e-9)
    index, _, rows = inverse_rows(layout, tips)
    np.testing.assert_allclose(frames(layout, rows)["tip"], tips[index], atol=1e-7)
    assert set(index.tolist()) == set(range(100))


def test_links_that_fold_onto_each_other_are_a_contact(layout: CellLayout) -> None:
    scene = Scene(layout, 60.0, 85.0)
    open_, folded = np.radians([[0.0, 90.0, -90.0, 0, 0, 0], [0.0, 90.0, 154.0, 0, 90.0, 0]])
    found = scene.contacts(np.stack([open_, folded]), 0.0)
    assert found.tolist() == [-1, scene.names().index("the arm itself")]


def test_a_reach_into_the_table_is_a_contact(layout: CellLayout) -> None:
    scene = Scene(layout, 60.0, 85.0)
    down = np.radians([[0.0, 10.0, -90.0, 0.0, 0.0, 0.0]])
    assert tcp_pose(layout, down)[0, 2, 3] < 0.0
    assert scene.contacts(down, 0.0).tolist() == [scene.names().index("table")]


def test_turret_and_upper_arm_stand_on_the_pedestal_and_the_forearm_does_not(
    layout: CellLayout,
) -> None:
    q = layout.park_q[None]
    x = BASE_X_MM
    round_the_turret = Box.from_bounds(x - 90.0, x + 90.0, -90.0, 90.0, 0.0, 560.0)
    at_the_forearm = Box.from_bounds(x + 100.0, x + 200.0, -90.0, 90.0, 0.0, 860.0)
    low, high = (
        Scene(replace(layout, column=box), 60.0, 85.0) for box in (round_the_turret, at_the_forearm)
    )
    assert low.contacts(q, 0.0).tolist() == [-1]
    assert high.contacts(q, 0.0).tolist() == [high.names().index("column")]


def test_a_wall_is_got_round_and_the_path_is_the_same_each_time(layout: CellLayout) -> None:
    wall = Box.from_bounds(250.0, 500.0, -10.0, 10.0, 0.0, 480.0)
    scene = Scene(layout, 60.0, 85.0, standing=(wall,))
    left, right = np.radians([[13.0, 40.0, -75.0, 0, 55.0, 0], [-25.0, 40.0, -75.0, 0, 55.0, 0]])
    assert scene.free(np.stack([left, right]), 5.0).all()
    assert not path_free(scene, [left, right])
    path = connect(left, right, scene, "test")
    np.testing.assert_array_equal(np.stack(path), np.stack(connect(left, right, scene, "test")))
    np.testing.assert_array_equal(path[-1], right)
    assert path_free(scene, [left, *path])


def test_what_it_cannot_reach_is_refused_with_its_own_numbers(layout: CellLayout) -> None:
    part = load_part(RECIPES / "parts" / "holder.stl")
    tray = replace(layout.trays["accept"], centre_mm=(1500.0, 0.0))
    far = replace(layout, trays={**layout.trays, "accept": tray})
    prepared = prepare_part(part.solid, part.chosen_by, far, PlanOptions().coarse())
    pose = max(part.poses, key=lambda p: p.probability)
    T = resting_pose(part.solid, pose, 360.0, 0.0)
    # 1500 + 120 from the turret's axis; 60 + 420 + 390 to the wrist, 177 to the tip
    with pytest.raises(OutOfReachError, match=r"1620 mm from the arm's axis.* reaches 1047 mm"):
        plan_from(prepared, far, OnTable(pose.index, T))
