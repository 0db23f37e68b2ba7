"""The driver against an arm unlike its description: play of its gears, zeros, sag, coupling.

The emulated arm has the errors between its motors and its joints; the driver has what a calibration
would have found of them. Sections (§) are those of umi_rtx.md.
"""

import math

import numpy as np
import pytest
from umi_bench import EMULATED, ArmBench, arm_bench

from drivers.umi_scara import ArmConfig, ArmGeometry, Axis, kinematics
from emulators.umi_scara import COUNTS_PER_DEG, ArmErrors, ArmJoints

PLAY_DEG = {
    Axis.SHOULDER: 0.28,
    Axis.ELBOW: 0.21,
    Axis.YAW: 0.3,
    Axis.WRIST1: 0.15,
    Axis.WRIST2: 0.2,
}
PLAY = {axis: deg * COUNTS_PER_DEG[EMULATED[axis]] for axis, deg in PLAY_DEG.items()}
# half a count of rounding where the motor goes, as much where the play ends, and DEAD_BAND 2 (7)
NEAR_COUNTS = 3.1


def errors(**others: object) -> ArmErrors:
    return ArmErrors(play_counts={EMULATED[axis]: n for axis, n in PLAY.items()}, **others)  # type: ignore[arg-type]


def near_the_park(count: int) -> np.ndarray:
    """Small moves this way and that, so that gears change flanks."""
    draw = np.random.default_rng(31).uniform(-1.0, 1.0, (count, 6))
    spans = np.array([*np.radians([6.0, 9.0, 6.0]), 12.0, *np.radians([8.0, 8.0])])
    return draw * spans + [0.0, 0.0, 0.0, -40.0, math.radians(-20.0), 0.0]


def joint_counts(bench: ArmBench) -> dict[Axis, float]:
    """Where the far sides of the gears are, by the emulator [counts]."""
    model = bench.model
    return {axis: model._driven[EMULATED[axis]] for axis in PLAY}


async def test_joints_get_where_they_are_sent_whichever_side_they_come_from() -> None:
    async with arm_bench(
        config=ArmConfig(play_counts=PLAY), errors=errors(), line="socket"
    ) as bench:
        await bench.as_if_homed()
        first = np.array([*np.radians([20.0, 20.0, 20.0]), -60.0, *np.radians([-40.0, 30.0])])
        worst = 0.0
        for number, q in enumerate([first, *near_the_park(8)]):
            await bench.arm.move_joints(q)
            if number == 0:
                continue  # by then every gear has been taken along once
            wanted = dict(zip(kinematics.COUNTS_ORDER, kinematics.q_to_counts(q), strict=True))
            reached = joint_counts(bench)
            # the joints' zeros are those of motors that have come from below
            off = {axis: reached[axis] + PLAY[axis] / 2 - wanted[axis] for axis in PLAY}
            worst = max(worst, *map(abs, off.values()))
            read = kinematics.q_to_counts(await bench.arm.read_q())
            for axis, counts in zip(kinematics.COUNTS_ORDER, read, strict=True):
                if axis in PLAY:
                    assert counts == pytest.approx(reached[axis] + PLAY[axis] / 2, abs=1.0), axis
        assert worst < NEAR_COUNTS


async def test_without_its_play_in_the_settings_the_arm_is_off_by_it() -> None:
    async with arm_bench(errors=errors(), line="socket") as bench:
        await bench.as_if_homed()
        worst = 0.0
        for q in near_the_park(9):
            await bench.arm.move_joints(q)
            wanted = dict(zip(kinematics.COUNTS_ORDER, kinematics.q_to_counts(q), strict=True))
            reached = joint_counts(bench)
            off = {axis: reached[axis] + PLAY[axis] / 2 - wanted[axis] for axis in PLAY}
            worst = max(worst, *map(abs, off.values()))
        assert worst > 6.0  # of the shoulder's 8.2


def test_the_model_of_a_calibrated_arm_has_its_joints_where_the_emulated_one_has_them() -> None:
    """Both readings of the same errors agree, over the whole range of the joints."""
    zero_deg = {"shoulder": 0.4, "elbow": -0.45, "yaw": 0.3, "pitch": -0.2, "roll": 0.5}
    arm = ArmErrors(
        zero_rad={f"{name}_rad": math.radians(deg) for name, deg in zero_deg.items()},
        zed_zero_mm=-0.4,
        yaw_per_elbow=0.004,
        sag_mm=0.7,
    )
    geometry = ArmGeometry(
        zero_rad=tuple(math.radians(deg) for deg in zero_deg.values()),  # type: ignore[arg-type]
        zed_zero_mm=-0.4,
        yaw_per_elbow=0.004,
        sag_mm=0.7,
    )
    low, high = kinematics.JOINT_RANGES
    rows = low + np.random.default_rng(5).random((50, 6)) * (high - low)
    found = geometry.from_counters(rows)
    for q, true in zip(rows, found, strict=True):
        shoulder, elbow, yaw, zed, pitch, roll = q
        joints = arm.joints(ArmJoints(shoulder, elbow, yaw, zed, pitch, roll, 40.0))
        np.testing.assert_allclose(
            true,
            [
                joints.shoulder_rad,
                joints.elbow_rad,
                joints.yaw_rad,
                joints.zed_mm,
                joints.pitch_rad,
                joints.roll_rad,
            ],
            atol=1e-12,
        )
