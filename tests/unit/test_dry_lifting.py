"""A plan's motions lifted: higher than planned, clear of a thicker cell, or named as left out."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from controller.bring_up.dry import LiftedStep, dry_scene, lift_plan, motions_of
from controller.bring_up.jogging import near_by, shifted
from controller.config import load_cell
from controller.planning import Look, Park, Pick, Plan, Proof, SetDown, Step
from controller.planning.model import CellLayout
from controller.planning.motion import tcp_pose
from controller.setup.layout import build_layout

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[2]
OVER_THE_TABLE = np.array([0.4, -1.2, -0.5, -500.0, -np.pi / 2, 0.2])


@pytest.fixture(scope="module")
def layout() -> CellLayout:
    return build_layout(load_cell(ROOT / "recipes/cells/emulated.yaml"))


def park(*waypoints: Array, label: str = "go") -> Park:
    return Park(seconds=1.0, label=label, motion=tuple(waypoints))


def plan_of(*steps: Step) -> Plan:
    return Plan(
        steps=steps, place={}, park={}, covered_fraction=0.0, covered_U=0.0,
        reachable_fraction=0.0, unseen=(), grasps=(), proof=Proof(0.0, 0.0, ""),
    )  # fmt: skip


def at_height(layout: CellLayout, z_mm: float) -> Array:
    T = tcp_pose(layout, OVER_THE_TABLE)
    q = OVER_THE_TABLE
    while abs(down := z_mm - tcp_pose(layout, q)[2, 3]) > 0.1:
        q = near_by(layout, q, shifted(tcp_pose(layout, q), "z", float(np.clip(down, -25, 25))))
    assert tcp_pose(layout, q)[:2, 3] == pytest.approx(T[:2, 3], abs=1.0)
    return q


def lifted(layout: CellLayout, *steps: Step) -> list[LiftedStep]:
    return list(lift_plan(layout, plan_of(*steps)))


def between(one: Array, other: Array) -> Array:
    share = np.linspace(0.0, 1.0, 40)[:, None]
    return np.asarray(one + share * (other - one))


def test_a_waypoint_at_the_table_is_lifted_by_100_mm_and_nothing_beside(layout: CellLayout) -> None:
    low = at_height(layout, 8.0)
    (step,) = lifted(layout, park(low))
    assert step.lifted_mm == (100.0, 100.0)
    assert not step.left_out
    before, after = tcp_pose(layout, low), tcp_pose(layout, step.path[-1])
    assert after[:3, 3] - before[:3, 3] == pytest.approx([0.0, 0.0, 100.0], abs=0.05)
    assert after[:3, :3] == pytest.approx(before[:3, :3], abs=1e-4)


def test_all_of_the_way_keeps_clear_of_a_cell_20_mm_thicker(layout: CellLayout) -> None:
    low, beside = at_height(layout, 8.0), at_height(layout, 8.0) + 0.3 * np.eye(6)[0]
    steps = lifted(layout, park(low), park(beside, layout.park_q))
    q = np.asarray(layout.park_q, dtype=float)
    scene = dry_scene(layout)
    for step in steps:
        assert not step.left_out
        for one, other in pairwise([q, *step.path]):
            rows = between(one, other)
            assert scene.free(rows, 0.0).all()
            assert tcp_pose(layout, rows)[:, 2, 3].min() > 100.0
        q = step.path[-1]
    for name, box in layout.obstacles.items():
        assert scene.layout.obstacles[name].half_mm == pytest.approx(box.half_mm + 20.0)


def test_between_the_jaws_of_the_fixed_gripper_the_arm_is_lifted_out_of_them(
    layout: CellLayout,
) -> None:
    """The two fingers are open along z: what goes in between them has to come above them."""
    T_fixed = layout.T_world_fixed_tcp
    assert layout.fixed_gripper is not None
    top_mm = max(
        float(box.placed(T_fixed).T[2, 3] + np.abs(box.placed(T_fixed).T[2, :3]) @ box.half_mm)
        for box in layout.fixed_gripper.fingers(layout.fixed_open_mm)
    )
    T = np.eye(4)
    # pointing at it, level, its own way round
    T[:3, :3] = np.column_stack([-T_fixed[:3, 0], [1, 0, 0], np.cross(-T_fixed[:3, 0], [1, 0, 0])])
    T[:3, 3] = T_fixed[:3, 3]
    index, _, q = layout.arm.inverse(np.linalg.inv(layout.T_world_arm) @ T[None])
    assert len(index)
    assert np.linalg.norm(tcp_pose(layout, q[0])[:3, 3] - T[:3, 3]) < 1e-6
    (step,) = lifted(layout, park(q[0]))
    fingers_low_mm = 35.0  # half of the least that the open arm gripper is wide
    for one in step.path:
        T_tcp = tcp_pose(layout, one)
        near = np.linalg.norm(T_tcp[:2, 3] - T_fixed[:2, 3]) < 60.0
        assert not near or T_tcp[2, 3] - fingers_low_mm > top_mm
    assert step.path or step.left_out


def test_what_no_lift_makes_free_is_left_out_with_its_reason(layout: CellLayout) -> None:
    low = at_height(layout, 8.0)
    unreachable = low - 2000.0 * np.eye(6)[3]
    (step,) = lifted(layout, park(low, unreachable, label="park"))
    assert len(step.left_out) == 1
    assert step.left_out[0].startswith("park: no lift of x")
    assert tcp_pose(layout, step.path[-1])[2, 3] == pytest.approx(108.0, abs=0.2)


def test_all_motions_of_a_step_are_driven_and_a_look_has_none() -> None:
    a, b, c, d = (np.full(6, float(n)) for n in range(4))
    grasp, T = None, np.eye(4)
    pick = Pick(
        seconds=1.0, label="pick", grasp=grasp, motion_in=(a, b), pre_open_mm=1.0,
        motion_down=(c,), expected_opening_mm=1.0, motion_up=(d,),
    )  # type: ignore[arg-type]  # fmt: skip  # no grasp is looked at
    down = SetDown(
        seconds=1.0, label="down", grasp=grasp, motion=(a,), motion_down=(b,), open_mm=1.0,
        motion_up=(c,), T_world_part=T, pose_index=0,
    )  # type: ignore[arg-type]  # fmt: skip
    look = Look(
        seconds=1.0, label="look", view_id="v", T_world_part=T, direction_part=a, seen=a > 0
    )
    assert [float(q[0]) for q in motions_of(pick)] == [0.0, 1.0, 2.0, 3.0]
    assert [float(q[0]) for q in motions_of(down)] == [0.0, 1.0, 2.0]
    assert motions_of(look) == ()
