"""The emulated cell with a UR5e: what may befall it, and what it runs into."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from emu_faults_bench import StillCell

from emulators.as_built import draw_as_built
from emulators.ur_arm import ScriptReader, UrArm
from emulators.world import read_layout
from emulators.world.chain import TCP
from emulators.world.poses import forward

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "ur5e.yaml"
PARK_RAD = np.radians((0.0, -110.0, 130.0, -110.0, -90.0, 0.0))


class StillUrCell(StillCell):
    file = CELL

    @property
    def ur(self) -> UrArm:
        assert isinstance(self.arm, UrArm)
        return self.arm


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[StillUrCell]:
    one = StillUrCell(tmp_path)
    yield one
    one.world.close()


def test_it_stands_where_it_was_left(cell: StillUrCell) -> None:
    np.testing.assert_allclose(cell.arm.joints().q, PARK_RAD)
    cell.pass_time(0.5)
    np.testing.assert_allclose(cell.arm.joints().q, PARK_RAD)
    assert cell.world.collisions == []


def test_the_verbs_of_a_ur_arm_act_on_the_cells_arm(cell: StillUrCell) -> None:
    cell.ur.start_running()
    cell.verbs.do("arm_protective_stop", cause="payload")
    state = cell.verbs.do("arm_state")
    assert (state["safety_mode"], state["stop_cause"]) == ("PROTECTIVE_STOP", "payload")
    cell.verbs.do("arm_mode", remote=False)
    assert not cell.ur.is_remote


@pytest.mark.parametrize(
    ("verb", "order"),
    [
        ("arm_ip", {"ip": 0}),
        ("arm_push", {"axis": "elbow", "counts": 10}),
        ("gear_play", {"axis": "elbow", "deg": 0.2}),
        ("noise", {"probability": 0.1}),
    ],
)
def test_what_befalls_only_a_umi_rtx_is_refused_by_name(
    verb: str, order: dict[str, object], cell: StillUrCell
) -> None:
    with pytest.raises(ValueError, match="no UMI RTX"):
        cell.verbs.do(verb, **order)


def test_an_arm_that_is_let_go_is_led_onto_the_table_with_its_fingers_down(
    cell: StillUrCell,
) -> None:
    q = _at_height(cell, np.radians((0.0, -54.0, 96.0, -132.0, -90.0, 0.0)), 40.0)
    cell.ur.place(q.tolist())
    cell.ur.start_running()
    before = forward(cell.layout.arm, cell.arm.joints())[TCP]
    with pytest.raises(ValueError, match="motors hold the arm"):
        cell.verbs.do("guide")
    (program,) = ScriptReader().feed(b"def led():\n freedrive_mode()\n sleep(60)\nend\n")
    assert cell.ur.start(program) == ""
    cell.pass_time(0.1)
    cell.verbs.do("guide")
    after = forward(cell.layout.arm, cell.arm.joints())[TCP]
    np.testing.assert_allclose(after[:2, 3], before[:2, 3], atol=0.1)
    assert 0.0 < after[2, 3] < 0.6
    np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=2e-3)
    (stop,) = ScriptReader().feed(b"stopj(2)\n")
    cell.ur.start(stop)
    with pytest.raises(ValueError, match="motors hold the arm"):
        cell.verbs.do("guide", tray="accept", corner=[1, -1])


def test_the_emergency_stop_takes_its_power_and_released_it_stays_without(
    cell: StillUrCell,
) -> None:
    cell.ur.start_running()
    cell.verbs.do("estop")
    cell.pass_time(1.0)
    state = cell.verbs.do("arm_state")
    assert (state["robot_mode"], state["safety_mode"]) == ("POWER_OFF", "ROBOT_EMERGENCY_STOP")
    cell.verbs.do("estop", pressed=False)
    assert cell.verbs.do("reset") == {"chain_ok": True}
    cell.pass_time(0.1)
    state = cell.verbs.do("arm_state")
    assert (state["robot_mode"], state["safety_mode"]) == ("POWER_OFF", "NORMAL")


def test_its_controller_loses_its_supply_with_the_cells_verb(cell: StillUrCell) -> None:
    cell.ur.start_running()
    cell.verbs.do("power", device="arm")
    assert not cell.arm_unit.is_powered
    assert cell.verbs.do("arm_state")["robot_mode"] == "POWER_OFF"
    cell.verbs.do("power", device="arm", on=True)
    assert cell.arm_unit.is_powered


def test_an_arm_that_runs_into_the_table_stops_protectively(cell: StillUrCell) -> None:
    """The wrist turns the fingertips into the table: the arm stops within a few millimetres."""
    arm = cell.ur
    # the fingertips straight down, 3 mm above the table beside the drop area
    q = np.radians((0.0, -54.0, 96.0, -132.0, -90.0, 0.0))
    q = _at_height(cell, q, 3.0)
    arm.place(q.tolist())
    arm.start_running()
    cell.pass_time(0.1)
    assert cell.world.collisions == []
    lower = q.copy()
    lower[1] += math.radians(10.0)
    (program,) = ScriptReader().feed(f"movej({lower.tolist()}, a=1.0, v=0.3)\n".encode())
    assert arm.start(program) == ""
    cell.pass_time(2.0)
    assert cell.verbs.do("arm_state")["safety_mode"] == "PROTECTIVE_STOP"
    assert {one.other for one in cell.world.collisions} == {"table"}
    assert forward(cell.layout.arm, arm.joints())[TCP][2, 3] > -5.0


def _at_height(cell: StillUrCell, q: np.ndarray, height_mm: float) -> np.ndarray:
    """Turn the shoulder until the TCP is so high."""
    low, high = q[1] - 0.5, q[1] + 0.5
    for _ in range(60):
        q[1] = (low + high) / 2.0
        z = cell.layout.arm.chain.poses(cell.layout.arm.T_world_base, q.tolist())[TCP][2, 3]
        low, high = (q[1], high) if z > height_mm else (low, q[1])
    return q


def test_as_built_its_controller_goes_by_the_drawing_and_the_world_by_the_arm(
    tmp_path: Path,
) -> None:
    cell = StillUrCell(tmp_path, as_built=3)
    try:
        built = draw_as_built(read_layout(CELL), 3).layout
        np.testing.assert_allclose(cell.arm.joints().q, PARK_RAD)
        true = cell.world.snapshot().poses[TCP]
        np.testing.assert_allclose(true, forward(built.arm, cell.arm.joints())[TCP])
        drawn = forward(read_layout(CELL).arm, cell.arm.joints())[TCP]
        assert 0.2 < np.linalg.norm(true[:3, 3] - drawn[:3, 3]) < 15.0
    finally:
        cell.world.close()
