"""Play of the gears and repeatability of homing, from pictures of the same stops."""

from __future__ import annotations

from dataclasses import replace

import kinematic_cells as cells
import numpy as np
import pytest

from controller.calibration.kinematics import (
    KinematicsError,
    StopPicture,
    UnknownsLayout,
    measure_homing,
    measure_play,
)
from drivers.umi_scara import ArmGeometry, UmiFigures
from drivers.umi_scara.model import kinematics
from drivers.umi_scara.protocol import constants as c

MOTORS = ("shoulder", "elbow", "yaw", "wrist1", "wrist2")  # in the order of TrueArm.play_rad


def stops_of(
    cell: cells.TrueCell, at: list[tuple[np.ndarray, str]], camera: str = "overhead"
) -> list[StopPicture]:
    """At each stop all motors from below, then each of them from above in turn."""
    out = []
    for n, (q, face) in enumerate(at):
        for above in ((), *((m,) for m in MOTORS)):
            side = np.array([0.5 if m in above else -0.5 for m in MOTORS])
            one = cell.held(f"{n}{above}", camera, face, "grasp0", q, side=side)
            if one is not None:
                out.append(StopPicture(one, f"stop{n}", frozenset(above)))
    return out


def where(count: int, seed: int) -> list[tuple[np.ndarray, str]]:
    return cells.in_sight("overhead", np.random.default_rng(seed), count)


@pytest.mark.parametrize("seed", [31, 32])
def test_the_play_of_each_motor_is_found_before_the_cell_is_known(seed: int) -> None:
    cell = cells.true_cell(seed)
    layout = UnknownsLayout(cells.prior())
    found = measure_play(
        layout,
        np.zeros(layout.size),
        stops_of(cell, where(5, seed)),
        layout.prior.arm.motors,  # type: ignore[attr-defined]
    )
    for name, play in zip(MOTORS, cell.arm.play_rad, strict=True):
        assert found[name].rad == pytest.approx(play, abs=3.0 * found[name].u_rad), name
        assert found[name].u_rad < np.radians(0.04), name


def test_a_degree_of_play_is_far_from_what_gears_have() -> None:
    cell = cells.true_cell(33)
    play = cell.arm.play_rad.copy()
    play[2] = np.radians(1.0)
    cell = replace(cell, arm=replace(cell.arm, play_rad=play))
    layout = UnknownsLayout(cells.prior())
    found = measure_play(
        layout,
        np.zeros(layout.size),
        stops_of(cell, where(3, 33)),
        layout.prior.arm.motors,  # type: ignore[attr-defined]
    )
    assert np.degrees(found["yaw"].rad) == pytest.approx(1.0, abs=0.1)
    assert all(np.degrees(found[m].rad) < 0.4 for m in MOTORS if m != "yaw")


def test_a_motor_that_only_came_from_one_side_is_named() -> None:
    cell = cells.true_cell(34)
    stops = [s for s in stops_of(cell, where(2, 34)) if "elbow" not in s.above]
    layout = UnknownsLayout(cells.prior())
    with pytest.raises(KinematicsError, match="both sides of elbow"):
        measure_play(layout, np.zeros(layout.size), stops, layout.prior.arm.motors)  # type: ignore[attr-defined]


def test_the_motors_turn_the_joints_as_their_counts_do() -> None:
    per_deg = {
        c.Axis.ELBOW: c.ELBOW_COUNTS_PER_DEG,
        c.Axis.SHOULDER: c.SHOULDER_COUNTS_PER_DEG,
        c.Axis.YAW: c.YAW_COUNTS_PER_DEG,
        c.Axis.WRIST1: c.WRIST_COUNTS_PER_DEG,
        c.Axis.WRIST2: c.WRIST_COUNTS_PER_DEG,
    }
    motors = UmiFigures(ArmGeometry()).motors
    assert {axis.name.lower() for axis in per_deg} == set(motors)
    for axis, counts in per_deg.items():
        row = np.zeros(6)
        row[kinematics.COUNTS_ORDER.index(axis)] = counts
        turned = kinematics.counts_to_q(row) / np.radians(1.0)
        np.testing.assert_allclose(motors[axis.name.lower()], turned, atol=1e-9)


def homed(cell: cells.TrueCell, std: np.ndarray, count: int) -> tuple[list[StopPicture], list[int]]:
    stops, homings = [], []
    rng = np.random.default_rng(3)
    for h in range(count):
        arm = cell.arm
        d = std * rng.standard_normal(6)
        zero = arm.zero_rad + d[[0, 1, 2, 4, 5]]
        after = replace(cell, arm=replace(arm, zero_rad=zero, zed_zero_mm=arm.zed_zero_mm + d[3]))
        for n, (q, face) in enumerate(where(4, 35)):
            one = after.held(f"{h}-{n}", "overhead", face, "grasp0", q)
            if one is not None:
                stops.append(StopPicture(one, f"stop{n}"))
                homings.append(h)
    return stops, homings


def test_homing_that_scatters_is_seen_joint_by_joint() -> None:
    cell = cells.true_cell(35, joint_std=np.zeros(6))
    layout = UnknownsLayout(cells.prior())
    x = np.zeros(layout.size)
    none = measure_homing(layout, x, *homed(cell, np.zeros(6), 6))
    std = np.radians([0.05, 0, 0, 0, 0, 0])
    some = measure_homing(layout, x, *homed(cell, std, 6))
    drawn = np.random.default_rng(3)
    true = np.std([(std * drawn.standard_normal(6))[0] for _ in range(6)], ddof=1)
    assert some.homing_count == 6
    assert some.joint_std[0] == pytest.approx(true, rel=0.3)
    assert none.joint_std[0] < 0.3 * true
    # 0.05 deg at half a metre is 0.4 mm
    assert none.tcp_mm < 0.1 < some.tcp_mm < 1.0


def test_two_homings_are_too_few() -> None:
    cell = cells.true_cell(36)
    layout = UnknownsLayout(cells.prior())
    with pytest.raises(KinematicsError, match="2 homings"):
        measure_homing(layout, np.zeros(layout.size), *homed(cell, np.zeros(6), 2))
