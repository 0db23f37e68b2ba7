"""The first motions of an arm, driver against emulator: one motor a little, then homing in turn."""

import asyncio
from collections.abc import AsyncIterator

import pytest
from cross_bench import nothing_is_left, open_fds
from umi_bench import ArmBench, arm_bench

from drivers.errors import MotionStoppedError
from drivers.kinds import FirstContact, Stop
from drivers.umi_scara import Axis
from emulators.umi_scara import Axis as EmulatedAxis


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@pytest.fixture
async def bench() -> AsyncIterator[ArmBench]:
    async with arm_bench(line="socket") as bench:
        yield bench


async def test_registers_of_all_motors_are_read_and_nothing_moves(bench: ArmBench) -> None:
    await bench.arm.connect()
    before = bench.true_counts()
    found = await bench.arm.read_registers()
    assert isinstance(bench.arm, FirstContact)
    assert set(found) == set(bench.arm.motors) == {axis.name.lower() for axis in Axis}
    # umi_rtx.md 2.5 numbers them 0 to 14
    assert all(len(registers) == 15 for registers in found.values())
    assert bench.true_counts() == before


@pytest.mark.parametrize("axis", [Axis.SHOULDER, Axis.ELBOW, Axis.GRIPPER])
async def test_a_tried_motor_moves_by_50_counts_and_back_and_no_other_does(
    bench: ArmBench, axis: Axis
) -> None:
    await bench.arm.connect()
    await bench.arm.enable_power()
    before = bench.true_counts()
    furthest = dict.fromkeys(Axis, 0.0)

    def look(_: object) -> None:
        for one, counts in bench.true_counts().items():
            furthest[one] = max(furthest[one], abs(counts - before[one]))

    bench.on_exchange = look
    tried = await bench.arm.try_motor(axis.name.lower())
    assert tried.went_counts == pytest.approx(50, abs=4)  # DEAD_BAND 2, two of reading
    assert tried.back_counts == pytest.approx(0, abs=4)
    assert furthest[axis] == pytest.approx(50, abs=6)
    # yaw is dragged by the elbow at most (umi_rtx.md 4.1)
    others = [one for one in Axis if one not in (axis, Axis.YAW)]
    assert max(furthest[one] for one in others) < 2
    assert not bench.arm.is_homed


async def test_a_motor_at_its_stop_is_tried_the_other_way(bench: ArmBench) -> None:
    await bench.arm.connect()
    await bench.arm.enable_power()
    # zed is at its top after homing (umi_rtx.md 4.1)
    bench.model.place(dict.fromkeys(EmulatedAxis, 0.0))
    tried = await bench.arm.try_motor("zed")
    assert tried.ordered_counts == -50
    assert tried.went_counts == pytest.approx(-50, abs=4)
    assert tried.back_counts == pytest.approx(0, abs=4)


async def test_a_homed_arm_is_not_tried(bench: ArmBench) -> None:
    await bench.as_if_homed()
    with pytest.raises(ValueError, match="homed"):
        await bench.arm.try_motor("zed")


async def test_homing_in_turn_waits_before_each_axis_and_nothing_moves_meanwhile(
    bench: ArmBench,
) -> None:
    await bench.arm.connect()
    await bench.arm.enable_power()
    asked: list[str] = []

    async def confirm(what: str) -> None:
        before = bench.true_counts()
        await bench.pass_time(1.0)
        assert bench.true_counts() == pytest.approx(before, abs=0.5)
        asked.append(what)

    await bench.arm.home_in_turn(confirm)
    assert bench.arm.is_homed
    assert len(asked) == 7  # five stops, the shoulder's once more, and the park
    assert "zed" in asked[0]
    assert [what.startswith("the shoulder turns") for what in asked].count(True) == 2


async def test_a_stop_while_a_person_is_asked_ends_the_homing(bench: ArmBench) -> None:
    await bench.arm.connect()
    await bench.arm.enable_power()
    asked = asyncio.Event()
    go_on = asyncio.Event()

    async def confirm(what: str) -> None:
        asked.set()
        await go_on.wait()

    homing = asyncio.create_task(bench.arm.home_in_turn(confirm))
    await asked.wait()
    before = bench.true_counts()
    await bench.arm.stop(Stop.DEAD)
    go_on.set()
    with pytest.raises(MotionStoppedError):
        await homing
    assert bench.true_counts() == pytest.approx(before, abs=0.5)
    assert not bench.arm.is_homed
