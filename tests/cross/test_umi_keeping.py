"""Homing with something in the jaws after a restart: no jaw opens, and a part that is gone shows.

Driver and emulated arm, the world's own view of jaws and axes beside what the driver reports.
"""

import numpy as np
import pytest
from umi_bench import ArmBench, arm_bench

from drivers.errors import PositionLostError
from drivers.umi_scara import Axis, Ip, kinematics
from emulators.umi_scara import Axis as EmulatedAxis

HELD_MM = 30.0
AT_STATION = np.array([0.6, -0.73, -2.08, -331.0, -0.87, 0.38])  # shoulder, elbow, yaw, zed, ...


class Jaws:
    """Notes the widest that the jaws ever stand from now on."""

    def __init__(self, bench: ArmBench) -> None:
        self.model = bench.model
        self.began_mm = self.widest_mm = bench.model.joints().jaw_opening_mm
        advance = bench.model.advance

        def noting(dt_s: float) -> None:
            advance(dt_s)
            self.widest_mm = max(self.widest_mm, self.model.joints().jaw_opening_mm)

        bench.model.advance = noting  # type: ignore[method-assign]


async def holding(bench: ArmBench) -> None:
    """Let it press on something 30 mm wide, at the station, and then lose both boards' memory."""
    await bench.as_if_homed()
    await bench.arm.move_joints(AT_STATION)
    await bench.arm.move_gripper_mm(45.0)
    bench.model.grasp_limit_mm = HELD_MM
    assert await bench.arm.grasp(40) == pytest.approx(HELD_MM, abs=0.5)


async def restart(bench: ArmBench, *ips: int) -> None:
    for ip in ips:
        bench.wire.restart(ip)
    await bench.arm.connect()
    await bench.arm.enable_power()


async def require_true_labels(bench: ArmBench) -> None:
    assert bench.arm.is_homed
    true = bench.true_counts()
    for axis, counts in (await bench.arm.read_counts()).items():
        assert counts == pytest.approx(true[axis], abs=3), axis


async def test_homing_with_a_part_labels_all_axes_and_opens_no_jaw() -> None:
    async with arm_bench() as bench:
        await holding(bench)
        await restart(bench, 1)
        jaws = Jaws(bench)
        opening_mm = await bench.arm.home_keeping_jaws(AT_STATION, HELD_MM)
        assert opening_mm == pytest.approx(HELD_MM, abs=0.5)
        assert jaws.widest_mm <= jaws.began_mm + 1e-6
        await require_true_labels(bench)
        # it goes on as if nothing had been: the jaws press, a move leaves them alone
        await bench.arm.move_joints(np.array([0.1, 0.0, 0.0, -30.0, 0.0, 0.0]))
        assert await bench.arm.grasp(40) == pytest.approx(HELD_MM, abs=0.5)
        assert jaws.widest_mm <= jaws.began_mm + 1e-6


async def test_an_arm_beside_its_estimate_is_homed_too_and_zed_goes_up_first() -> None:
    async with arm_bench() as bench:
        await holding(bench)
        await restart(bench, 0, 1)
        before = bench.true_counts()
        others = [axis for axis in Axis if axis not in (Axis.ZED, Axis.GRIPPER)]
        moved_at: list[float] = []
        advance = bench.model.advance

        def noting(dt_s: float) -> None:
            advance(dt_s)
            now = bench.true_counts()
            if not moved_at and any(abs(now[a] - before[a]) > 8 for a in others):
                moved_at.append(now[Axis.ZED])

        bench.model.advance = noting  # type: ignore[method-assign]
        beside = AT_STATION + np.array([0.06, -0.06, 0.06, 12.0, 0.06, -0.06])
        await bench.arm.home_keeping_jaws(beside, HELD_MM)
        assert moved_at == [pytest.approx(0.0, abs=2)]  # its upper stop
        await require_true_labels(bench)


async def test_a_part_that_is_gone_shows_by_how_far_the_jaws_close() -> None:
    async with arm_bench() as bench:
        await holding(bench)
        await restart(bench, 1)
        bench.model.grasp_limit_mm = None
        jaws = Jaws(bench)
        assert await bench.arm.home_keeping_jaws(AT_STATION, HELD_MM) == pytest.approx(0.0, abs=0.1)
        assert jaws.widest_mm <= jaws.began_mm + 1e-6


async def test_jaws_that_somebody_moved_are_refused_before_anything_moves() -> None:
    async with arm_bench() as bench:
        await holding(bench)
        await restart(bench, 1)
        await bench.arm.stop()
        bench.model.power_on[1] = False
        bench.model.push(EmulatedAxis.GRIPPER, 60.0)
        before = bench.true_counts()
        await bench.arm.enable_power()
        with pytest.raises(PositionLostError, match="jaws were moved"):
            await bench.arm.home_keeping_jaws(AT_STATION, HELD_MM)
        assert bench.true_counts() == pytest.approx(before, abs=0.5)
        assert not bench.arm.is_homed


async def test_what_one_board_has_kept_is_known_and_the_rest_is_not() -> None:
    async with arm_bench() as bench:
        await holding(bench)
        between = np.array([AT_STATION, np.zeros(6)])
        await restart(bench, int(Ip.WRIST))
        q = await bench.arm.read_kept_q(between)
        step = np.abs(kinematics.counts_to_q(np.eye(6))).max(axis=0)
        assert (np.abs(q - AT_STATION)[:4] <= 3 * step[:4]).all()
        assert np.isnan(q[4:]).all()
        await restart(bench, int(Ip.ARM))
        q = await bench.arm.read_kept_q(between)
        assert np.isnan(q).all()
