"""A driver on a recording of the emulated arm: the same session once more, and another one."""

import numpy as np
import pytest
from umi_bench import arm_bench

from drivers.clock import CellClock
from drivers.errors import DeviceError, UnpluggedError
from drivers.umi_scara import UmiScara, WireExchange
from drivers.umi_scara.line import Exchanged, RecordedLine, RecordedTransport

Q = np.array([0.3, -0.4, 0.2, -60.0, -0.4, 0.3])


async def session(arm: UmiScara, q: np.ndarray) -> np.ndarray:
    """Home, go somewhere and back half-way, with the jaws moved in between."""
    await arm.connect()
    await arm.enable_power()
    await arm.home()
    await arm.move_joints(q)
    await arm.move_gripper_mm(40.0)
    await arm.move_joints(q / 2)
    found = await arm.read_q()
    await arm.aclose()
    return found


async def test_a_recorded_session_runs_again_without_the_arm_and_another_one_is_refused() -> None:
    heard: list[WireExchange] = []
    async with arm_bench(line="socket") as bench:
        bench.on_exchange = heard.append
        q_end = await session(bench.arm, Q)
    exchanges = [Exchanged(one.at_s, one.request, one.reply) for one in heard]

    def recorded(speed: float) -> UmiScara:
        # no time-out may fire because this computer is busy
        clock = CellClock(speed, min_timeout_wall_s=600.0)
        line = RecordedLine(exchanges, "session")
        return UmiScara(lambda: RecordedTransport(line, clock), clock=clock)

    for speed in (25.0, 60.0):  # polls fall elsewhere each time
        np.testing.assert_array_equal(await session(recorded(speed), Q), q_end)
    other = Q + np.array([0.05, 0, 0, 0, 0, 0])
    with pytest.raises(UnpluggedError, match="the recording has 7"):
        await session(recorded(60.0), other)


async def test_connected_again_it_stands_where_the_recording_was_left() -> None:
    heard: list[WireExchange] = []
    async with arm_bench(line="socket") as bench:
        bench.on_exchange = heard.append
        await session(bench.arm, Q)
    exchanges = [Exchanged(one.at_s, one.request, one.reply) for one in heard]
    clock = CellClock(60.0, min_timeout_wall_s=0.5)
    line = RecordedLine(exchanges, "session")
    arm = UmiScara(lambda: RecordedTransport(line, clock), clock=clock)
    assert (await arm.connect()).was_restarted
    await arm.aclose()
    assert not (await arm.connect()).was_restarted
    await arm.enable_power()
    await arm.home()
    assert arm.is_homed
    with pytest.raises(DeviceError):
        await arm.move_joints(Q / 3)
    await arm.aclose()
