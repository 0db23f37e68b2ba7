"""The emulated cell as built: differences from the cell file, drawn from a seed."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emu_faults_bench import BLOCK_MM, StillCell

from emulators.as_built import as_drawn, draw_as_built
from emulators.umi_scara import ArmErrors, ArmJoints, ArmModel, Axis
from emulators.world import read_layout
from emulators.world.chain import TCP
from emulators.world.poses import forward

ROOT = Path(__file__).parents[2]
LAYOUT = read_layout(ROOT / "recipes" / "cells" / "emulated.yaml")
SEEDS = range(300, 420)
# what a tape measure and a spirit level leave: mm and degrees
BASE = (3.0, 0.5)
CAMERA = (5.0, 1.0)
FIXED_GRIPPER = (4.0, 1.0)
TILT_DEG = 0.2
# the table's tilt moves what stands on or over it: at most 1.3 m away
TILT_MM = 1300.0 * math.radians(TILT_DEG)


def off(T: np.ndarray, nominal: np.ndarray) -> tuple[float, float]:
    """Return how far apart two poses are [mm, degrees]."""
    turn = T[:3, :3] @ nominal[:3, :3].T
    cos = min(1.0, (np.trace(turn) - 1.0) / 2.0)
    return float(np.linalg.norm(T[:3, 3] - nominal[:3, 3])), math.degrees(math.acos(cos))


def test_the_same_seed_builds_the_same_cell_and_another_seed_another() -> None:
    once, again = draw_as_built(LAYOUT, 5).truth(), draw_as_built(LAYOUT, 5).truth()
    assert once == again
    assert once != draw_as_built(LAYOUT, 6).truth()


def test_truth_is_plain_values() -> None:
    truth = draw_as_built(LAYOUT, 5).truth()
    assert json.loads(json.dumps(truth)) == truth


def test_as_drawn_nothing_differs() -> None:
    built = as_drawn(LAYOUT)
    assert built.layout is LAYOUT
    assert built.arm == ArmErrors()
    assert built.oversize_mm == 0.0


@pytest.mark.parametrize(
    ("what", "bound"),
    [("base", BASE), ("overhead", CAMERA), ("inspection", CAMERA), ("fixed", FIXED_GRIPPER)],
)
def test_poses_are_off_within_their_bounds_and_use_them(
    what: str, bound: tuple[float, float]
) -> None:
    far = []
    for seed in SEEDS:
        layout = draw_as_built(LAYOUT, seed).layout
        pairs = {
            "base": (layout.arm.T_world_base, LAYOUT.arm.T_world_base),
            "fixed": (layout.fixed_gripper.T_world_tcp, LAYOUT.fixed_gripper.T_world_tcp),
        } | {
            name: (layout.cameras[name].T_world_cam, LAYOUT.cameras[name].T_world_cam)
            for name in LAYOUT.cameras
        }
        far.append(off(*pairs[what]))
    mm, deg = np.array(far).T
    assert mm.max() <= bound[0] + TILT_MM
    assert deg.max() <= bound[1] + TILT_DEG + 1e-6
    assert np.median(mm) > 0.5 * bound[0]
    assert np.median(deg) > 0.5 * bound[1]


def test_lenses_lamps_trays_and_parts_differ_within_their_bounds() -> None:
    for seed in SEEDS:
        built = draw_as_built(LAYOUT, seed)
        for name, camera in built.layout.cameras.items():
            assert abs(camera.focal_px / LAYOUT.cameras[name].focal_px - 1.0) <= 0.01
            assert not np.array_equal(camera.distortion, LAYOUT.cameras[name].distortion)
        for tray, nominal in zip(built.layout.trays, LAYOUT.trays, strict=True):
            assert np.linalg.norm(tray.centre_mm - nominal.centre_mm) <= 5.0
        assert all(0.8 <= one.full_level <= 1.2 for one in built.lamps.values())
        ramps = sorted(one.ramp_s for one in built.lamps.values())
        assert ramps[-1] > 5.0 * ramps[-2]  # one lamp is slow
        assert abs(built.oversize_mm) == pytest.approx(0.1)
        assert abs(built.layout.arm.shape.upper_mm - LAYOUT.arm.shape.upper_mm) <= 0.3
        assert abs(built.layout.arm.shape.tool_mm - LAYOUT.arm.shape.tool_mm) <= 0.5
        assert all(abs(math.degrees(zero)) <= 0.5 for zero in built.arm.zero_rad.values())


def test_a_joint_follows_its_motor_once_the_play_is_used_up() -> None:
    arm = ArmModel(1, ArmErrors(play_counts={Axis.ELBOW: 4.0}))
    arm.place({Axis.ELBOW: 50.0})
    arm.place({Axis.ELBOW: 100.0})  # upwards: the far side is 2 counts behind
    start = arm.joints().elbow_rad
    per_count = math.radians(1.0 / 14.611)  # umi_rtx.md 5.1
    arm.place({Axis.ELBOW: 150.0})
    assert arm.joints().elbow_rad - start == pytest.approx(50.0 * per_count)
    arm.place({Axis.ELBOW: 147.0})  # back by less than the play: nothing moves
    assert arm.joints().elbow_rad - start == pytest.approx(50.0 * per_count)
    arm.place({Axis.ELBOW: 140.0})  # the other flank, 2 counts ahead
    assert arm.joints().elbow_rad - start == pytest.approx(44.0 * per_count)


def test_zeros_coupling_and_sag_are_between_counters_and_joints() -> None:
    errors = ArmErrors(
        zero_rad={"shoulder_rad": 0.01, "pitch_rad": -0.004},
        zed_zero_mm=0.3,
        jaw_zero_mm=-0.2,
        yaw_per_elbow=0.005,
        sag_mm=0.8,
    )
    perfect, real = ArmModel(3), ArmModel(3, errors)
    for arm in (perfect, real):
        # the elbow at 60 degrees: of the stretched reach cos(30 deg) is left
        arm.place({Axis.ELBOW: 60.0 * 14.611, Axis.GRIPPER: 500.0})
    a, b = perfect.joints(), real.joints()
    assert b.shoulder_rad - a.shoulder_rad == pytest.approx(0.01)
    assert b.pitch_rad - a.pitch_rad == pytest.approx(-0.004)
    assert b.yaw_rad - a.yaw_rad == pytest.approx(0.005 * math.radians(60.0))
    assert b.zed_mm - a.zed_mm == pytest.approx(0.3 - 0.8 * 0.75)
    assert b.jaw_opening_mm - a.jaw_opening_mm == pytest.approx(-0.2)


def test_jaws_stop_on_a_part_at_its_true_width() -> None:
    """Pads 0.4 mm thinner: on a part of 30 mm the counter says 29.6 mm."""
    arm = ArmModel(2, ArmErrors(jaw_zero_mm=0.4))
    arm.place({Axis.GRIPPER: 900.0})
    arm.grasp_limit_mm = 30.0
    motor = arm.axes[Axis.GRIPPER]
    motor.goal = 0.0
    arm.release_estop()
    arm.set_power(1, on=True)
    motor.set_point = motor.target = -20.0
    for _ in range(2000):
        arm.advance(0.01)
    assert arm.joints().jaw_opening_mm == pytest.approx(30.0, abs=0.01)


def test_the_tool_stands_beside_the_approach_axis() -> None:
    joints = ArmJoints(shoulder_rad=0.3, elbow_rad=-0.5, yaw_rad=0.2, pitch_rad=-0.7)
    straight = forward(LAYOUT.arm, joints)[TCP]
    shape = replace(LAYOUT.arm.shape, tool_off_mm=(0.4, -0.3))
    beside = forward(replace(LAYOUT.arm, shape=shape), joints)[TCP]
    in_tcp = straight[:3, :3].T @ (beside[:3, 3] - straight[:3, 3])
    assert in_tcp == pytest.approx([0.0, 0.4, -0.3])


def test_the_control_port_returns_how_the_cell_really_stands(tmp_path: Path) -> None:
    cell = StillCell(tmp_path, as_built=11)
    stands = cell.verbs.do("as_built")
    assert stands == draw_as_built(LAYOUT, 11).truth()
    assert stands["lamps"]["table_ring"]["full_level"] != 1.0


def test_lamps_parts_and_jaws_of_a_cell_are_as_built(tmp_path: Path) -> None:
    cell = StillCell(tmp_path, as_built=11)
    built = draw_as_built(LAYOUT, 11)
    length_mm = np.ptp(cell.solids[0].vertices_mm, axis=0).max()
    assert length_mm == pytest.approx(BLOCK_MM[0] + built.oversize_mm)
    assert cell.arm.errors == built.arm
    assert np.array_equal(
        cell.world.layout.fixed_gripper.T_world_tcp, built.layout.fixed_gripper.T_world_tcp
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_column_stands_on_the_base_wherever_that_is(seed: int) -> None:
    drawn = LAYOUT.arm
    built = draw_as_built(LAYOUT, seed).layout.arm
    on_base = np.linalg.inv(built.T_world_base) @ built.T_world_column
    np.testing.assert_allclose(on_base, np.linalg.inv(drawn.T_world_base), atol=1e-9)
    assert not np.allclose(built.T_world_column, np.eye(4))


def test_the_fixed_grippers_fingertips_and_stroke_differ_and_what_it_reports_with_them(
    tmp_path: Path,
) -> None:
    drawn = [draw_as_built(LAYOUT, seed).fixed_jaws for seed in SEEDS]
    wider_mm = np.abs([one.wider_mm for one in drawn])
    stretch = np.abs([one.stretch - 1.0 for one in drawn])
    assert 0.4 < wider_mm.max() <= 0.5
    assert 0.008 < stretch.max() <= 0.01
    assert as_drawn(LAYOUT).fixed_jaws.wider_mm == 0.0
    cell = StillCell(tmp_path, as_built=11)
    errors = draw_as_built(LAYOUT, 11).fixed_jaws
    cell.jaws.opening_mm = 40.0
    cell.gripper.advance(0.01)
    # gPO is 3 with the jaws 85 mm apart and 230 with them closed, by design (modbus_devices.md 2.5)
    reading_mm = (230 - cell.gripper._input[4]) * 85.0 / 227.0
    true_mm = errors.wider_mm + errors.stretch * reading_mm
    assert abs(true_mm - 40.0) <= 0.51 * 85.0 / 227.0 * errors.stretch
