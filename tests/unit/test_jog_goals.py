"""Where a jog leads and where it may not go, by the pose that forward kinematics give for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from controller.bring_up.jogging import (
    GRAMMAR,
    JogOrder,
    RefusedMotionError,
    Verb,
    WrongOrderError,
    clearance_mm,
    near_by,
    read_order,
    require_free,
    shifted,
    turned,
)
from controller.config import load_cell
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, tcp_pose
from controller.setup.layout import build_layout

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[2]
# shoulder, elbow, yaw [rad], zed [mm], pitch, roll [rad]
SLANTED = np.array([0.4, -1.2, -0.5, -500.0, -1.2, 0.2])
STRAIGHT_DOWN = np.array([0.4, -1.2, -0.5, -500.0, -np.pi / 2, 0.2])


def by_zed(q: Array, up_mm: float) -> Array:
    return q + up_mm * np.eye(6)[3]


@pytest.fixture(scope="module")
def layout() -> CellLayout:
    return build_layout(load_cell(ROOT / "recipes/cells/emulated.yaml"))


@pytest.fixture(scope="module")
def scene(layout: CellLayout) -> Scene:
    return Scene(layout, layout.arm_gripper.max_mm, layout.fixed_open_mm)


@pytest.mark.parametrize("q", [SLANTED, STRAIGHT_DOWN], ids=["slanted", "straight down"])
@pytest.mark.parametrize("direction", ["x", "y", "z", "advance"])
@pytest.mark.parametrize("by_mm", [7.0, -15.0])
def test_the_tcp_goes_along_the_axis_by_the_amount_and_keeps_its_orientation(
    layout: CellLayout, q: Array, direction: str, by_mm: float
) -> None:
    T = tcp_pose(layout, q)
    axis = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}.get(direction, T[:3, 0])
    T_after = tcp_pose(layout, near_by(layout, q, shifted(T, direction, by_mm)))
    assert T_after[:3, 3] - T[:3, 3] == pytest.approx(by_mm * np.asarray(axis), abs=0.02)
    assert T_after[:3, :3] == pytest.approx(T[:3, :3], abs=1e-4)


@pytest.mark.parametrize(
    ("q", "axis"),
    [(SLANTED, "heading"), (SLANTED, "tilt"), (SLANTED, "spin"), (STRAIGHT_DOWN, "heading")],
)
def test_the_tcp_stays_where_it_is_while_the_tool_turns(
    layout: CellLayout, q: Array, axis: str
) -> None:
    T = tcp_pose(layout, q)
    T_after = tcp_pose(layout, near_by(layout, q, turned(T, axis, 2.0)))
    assert T_after[:3, 3] == pytest.approx(T[:3, 3], abs=0.02)
    R = T_after[:3, :3] @ T[:3, :3].T
    assert np.degrees(np.arccos((np.trace(R) - 1) / 2)) == pytest.approx(2.0, abs=0.01)
    before, after = T[:3, 0], T_after[:3, 0]
    if axis == "tilt":  # a positive tilt brings the approach up, within its own vertical plane
        assert np.degrees(np.arcsin(after[2]) - np.arcsin(before[2])) == pytest.approx(2, abs=0.01)
        assert np.arctan2(after[1], after[0]) == pytest.approx(np.arctan2(before[1], before[0]))
    elif axis == "spin":
        assert after == pytest.approx(before, abs=1e-4)
    else:
        assert after[2] == pytest.approx(before[2], abs=1e-4)


def test_a_stretched_arm_is_not_sent_further_out(layout: CellLayout) -> None:
    q = np.array([0.0, 0.0, 0.0, -300.0, -1.2, 0.0])
    with pytest.raises(RefusedMotionError, match="end of its reach"):
        near_by(layout, q, shifted(tcp_pose(layout, q), "x", 5.0))


def test_a_soft_limit_is_named(layout: CellLayout, scene: Scene) -> None:
    q = SLANTED.copy()
    q[3] = 100.0  # zed goes from 0 down
    with pytest.raises(RefusedMotionError, match=r"soft limit of the arm: .*zed"):
        require_free(scene, SLANTED, q)


def test_what_is_in_the_way_is_named(layout: CellLayout, scene: Scene) -> None:
    # with the tool straight down, the TCP stands tool_mm below the wrist: here 100 mm under z = 0
    q = STRAIGHT_DOWN.copy()
    q[3] -= tcp_pose(layout, q)[2, 3] + 100.0
    with pytest.raises(RefusedMotionError, match=r"table|soft limit"):
        require_free(scene, STRAIGHT_DOWN, q)


def test_out_of_a_place_that_is_too_near_only_the_way_out_is_free(
    layout: CellLayout, scene: Scene
) -> None:
    low = STRAIGHT_DOWN.copy()
    low[3] -= tcp_pose(layout, low)[2, 3] - 1.0  # pads 1 mm over the table: nearer than allowed
    assert clearance_mm(scene, low) < 2.0
    up, down = by_zed(low, 8.0), by_zed(low, -1.5)
    require_free(scene, low, up)
    with pytest.raises(RefusedMotionError, match=r"table.*is there already|soft limit"):
        require_free(scene, low, down)


def test_from_outside_its_limits_the_arm_may_come_in_and_not_stay_out(
    layout: CellLayout, scene: Scene
) -> None:
    # where homing leaves it: zed nearer to its stop than the soft limit
    homed = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert not layout.arm.within_limits(homed).all()
    require_free(scene, homed, np.array([0.0, 0, 0, -60.0, -0.5, 0]))
    with pytest.raises(RefusedMotionError, match="soft limit"):
        require_free(scene, homed, np.array([0.1, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize(
    ("text", "order"),
    [
        ("x +", JogOrder(Verb.SHIFT, "x", None, 1)),
        ("Z -2.5", JogOrder(Verb.SHIFT, "z", -2.5)),
        ("joint 3 -", JogOrder(Verb.JOINT, "3", None, -1)),
        ("tilt 4", JogOrder(Verb.TURN, "tilt", 4.0)),
        ("open fixed", JogOrder(Verb.OPEN, "fixed")),
        ("open arm 20", JogOrder(Verb.OPEN, "arm", 20.0)),
        ("lamp table_ring off", JogOrder(Verb.LAMP, "table_ring", 0.0)),
        ("step 3", JogOrder(Verb.STEP, "", 3.0)),
        ("motor elbow", JogOrder(Verb.MOTOR, "elbow")),
        ("quit", JogOrder(Verb.QUIT)),
    ],
)
def test_orders_are_read(text: str, order: JogOrder) -> None:
    assert read_order(text) == order


@pytest.mark.parametrize(
    "text",
    [
        "", "jump", "x", "x far", "x nan", "x 1 2", "x 101", "tilt 46", "joint one +", "joint 1",
        "open", "open both", "open arm -1", "lamp table_ring", "step 4", "step 1.5", "speed 26",
        "speed 0", "home now", "shift 5", "motor",
    ],
)  # fmt: skip
def test_what_is_no_order_is_refused_in_words(text: str) -> None:
    with pytest.raises(WrongOrderError, match=r"order|required|how much|few|numbered"):
        read_order(text)
    assert "joint NUMBER BY" in GRAMMAR
