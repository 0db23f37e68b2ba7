"""A second session takes over the positions of the first one, or refuses to; neither moves the arm.

Sections (§) are those of umi_rtx.md.
"""

from __future__ import annotations

from collections.abc import AsyncIterator

import numpy as np
import pytest
from umi_bench import ArmBench, arm_bench

from drivers.errors import PositionLostError
from drivers.umi_scara import Axis, Parameter, kinematics

# shoulder, elbow, yaw [rad], zed [mm], pitch, roll [rad]: inside all limits of §5.2
FIRST = np.array([0.1, 0.2, -0.1, -100.0, -0.8, 0.3])
SECOND = np.array([0.4, -0.3, 0.2, -160.0, -1.2, -0.2])


@pytest.fixture
async def bench() -> AsyncIterator[ArmBench]:
    async with arm_bench() as bench:
        await bench.as_if_homed()
        await bench.arm.move_joints(FIRST)
        await bench.arm.aclose()  # what a killed controller leaves: both IPs run, and hold
        yield bench


async def test_positions_go_on_where_the_arm_is_between_what_it_was_sent_to(
    bench: ArmBench,
) -> None:
    before = bench.true_counts()
    await bench.arm.connect()
    await bench.arm.take_over_positions(np.array([SECOND, FIRST]))
    assert bench.true_counts() == before
    assert bench.arm.is_homed
    assert await bench.arm.read_q() == pytest.approx(FIRST, abs=0.5)  # zed [mm]; others below
    await bench.arm.enable_power()
    await bench.arm.move_joints(SECOND, speed_share=0.5)
    counts = kinematics.q_to_counts(SECOND)
    truth = bench.true_counts()
    there = [truth[axis] for axis in kinematics.COUNTS_ORDER]
    assert np.abs(np.array(there) - counts).max() <= 4  # DEAD_BAND and the driver's slack


async def test_an_arm_that_is_elsewhere_is_not_believed(bench: ArmBench) -> None:
    await bench.arm.connect()
    with pytest.raises(PositionLostError, match="was sent between"):
        await bench.arm.take_over_positions(np.array([SECOND]))
    assert not bench.arm.is_homed


@pytest.mark.parametrize("ip", [0, 1])
async def test_an_ip_that_restarted_in_this_session_or_an_earlier_one_is_found_out(
    bench: ArmBench, ip: int
) -> None:
    bench.wire.restart(ip)
    await bench.arm.connect()
    with pytest.raises(PositionLostError, match="has restarted"):
        await bench.arm.take_over_positions(np.array([FIRST]))
    # the GO of that session hides the restart from the next one (§1.5): the counters do not
    await bench.arm.aclose()
    await bench.arm.connect()
    with pytest.raises(PositionLostError):
        await bench.arm.take_over_positions(np.array([FIRST, np.zeros(6)]))
    assert not bench.arm.is_homed


async def test_a_reduced_speed_is_that_share_of_the_usual_one(bench: ArmBench) -> None:
    await bench.arm.connect()
    await bench.arm.take_over_positions(np.array([FIRST]))
    await bench.arm.enable_power()
    speeds = []
    for target, share in ((SECOND, 1.0), (FIRST, 0.25)):
        await bench.arm.move_joints(target, speed_share=share)
        moved = [axis for axis in Axis if axis is not Axis.GRIPPER]
        speeds.append(
            max([await bench.arm.read_parameter(axis, Parameter.SPEED) for axis in moved])
        )
    assert speeds == [100, 25]  # of the axis that needs longest (§8.13)
