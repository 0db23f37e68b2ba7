"""The arm's driver and its emulator on a real terminal: opening, homing, moving, gripping.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Mapping
from itertools import pairwise

import numpy as np
import pytest
from cross_bench import nothing_is_left, open_fds
from umi_bench import EMULATED, ArmBench, arm_bench

from drivers.errors import LinkError, PositionLostError
from drivers.umi_scara import (
    ArmConfig,
    Axis,
    AxisStalledError,
    Ip,
    LinkConfig,
    MotionStoppedError,
    Parameter,
    PowerOffError,
    StatusBits,
    Stop,
    UmiScara,
    kinematics,
)
from emulators.umi_scara import ArmJoints

# umi_rtx.md 4.1 step 7, §4.2: where homing ends, by the arm's own scale
PARK = {axis: -18 if axis is Axis.ZED else 0 for axis in Axis}
LABEL_TOLERANCE = 3  # DEAD_BAND 2 (7), one of reading
ARRIVAL_TOLERANCE = 4  # DEAD_BAND and the driver's slack of 2


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@pytest.fixture
async def bench() -> AsyncIterator[ArmBench]:
    async with arm_bench() as bench:
        yield bench


@pytest.fixture
async def homed(bench: ArmBench) -> ArmBench:
    return await bench.as_if_homed()


def q_of(joints: ArmJoints) -> list[float]:
    """The emulator's joints in the driver's order; each side scales by its own reading of 5.1."""
    by_name = {
        "shoulder": joints.shoulder_rad,
        "elbow": joints.elbow_rad,
        "yaw": joints.yaw_rad,
        "zed": joints.zed_mm,
        "pitch": joints.pitch_rad,
        "roll": joints.roll_rad,
    }
    return [by_name[name.removesuffix("_rad").removesuffix("_mm")] for name in kinematics.Q_ORDER]


async def is_at_rest(bench: ArmBench, wait_s: float = 1.0) -> bool:
    before = bench.true_counts()
    await bench.pass_time(wait_s)
    return bench.true_counts() == pytest.approx(before, abs=0.5)


# ---- opening -------------------------------------------------------------------------------------
@pytest.mark.parametrize("listening", [0, 1])
async def test_a_cold_arm_is_opened_whichever_board_listens_and_nothing_moves(
    listening: int,
) -> None:
    async with arm_bench(listening=listening) as bench:
        before = bench.true_counts()
        identity = await bench.arm.connect()
        await bench.arm.enable_power()
        await bench.pass_time(1.0)
        assert identity.restarted_ips == {Ip.WRIST, Ip.ARM}
        assert identity.rom_versions == {Ip.WRIST: (2, 3), Ip.ARM: (2, 3)}  # §3.1's placeholders
        assert bench.true_counts() == before
        assert bench.model.power_on == [True, True]
        assert not bench.refused()
        with pytest.raises(PositionLostError, match="not homed"):
            await bench.arm.read_counts()


@pytest.mark.parametrize("listening", [0, 1])
async def test_a_warm_arm_is_opened_and_its_positions_are_not_believed(listening: int) -> None:
    async with arm_bench(listening=listening) as bench:
        bench.wire.run_warm()
        identity = await bench.arm.connect()
        assert not identity.was_restarted
        with pytest.raises(PowerOffError):  # §8.10: it is not known whether 27 was ever sent
            await bench.arm.home()
        with pytest.raises(PositionLostError, match="not homed"):
            await bench.arm.read_counts()


async def test_one_restarted_board_beside_a_running_one_is_told(bench: ArmBench) -> None:
    bench.wire.run_warm()
    bench.wire.restart(0)
    assert (await bench.arm.connect()).restarted_ips == {Ip.WRIST}


async def test_opening_does_not_wait_for_the_patience_of_time_outs() -> None:
    patient = ArmConfig(link=LinkConfig(reply_timeout_s=300.0))
    async with arm_bench(speed=10.0, config=patient) as bench:
        began_s = bench.clock.now_s()
        await bench.arm.connect()
        assert bench.clock.now_s() - began_s < 150.0


async def test_a_second_driver_cannot_have_the_line(bench: ArmBench) -> None:
    await bench.arm.connect()
    other = UmiScara(str(bench.server.path), clock=bench.clock)
    with pytest.raises(LinkError, match="cannot open"):
        await other.connect()
    assert await bench.arm.status(Axis.ZED) & StatusBits.MOVING == 0


# ---- homing --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "seed", [8, *(pytest.param(n, marks=pytest.mark.slow) for n in range(20, 30))]
)
async def test_homing_labels_every_axis_with_where_it_truly_is(seed: int) -> None:
    async with arm_bench(seed=seed, listening=seed % 2) as bench:
        await bench.homed()
        reported = await bench.arm.read_counts()
        true = bench.true_counts()
        assert true == pytest.approx(reported, abs=LABEL_TOLERANCE)
        assert reported == pytest.approx(PARK, abs=ARRIVAL_TOLERANCE)
        # 4 counts are 0.41 degrees of the coarsest joint, yaw, and 1.1 mm of zed
        q, true_q = await bench.arm.read_q(), q_of(bench.model.joints())
        assert q == pytest.approx(true_q, abs=1.1)
        turns = [n for n, name in enumerate(kinematics.Q_ORDER) if "zed" not in name]
        assert q[turns] == pytest.approx(np.array(true_q)[turns], abs=math.radians(0.42))
        assert not bench.refused()
        forces = {a: await bench.arm.read_parameter(a, Parameter.MAX_FORCE) for a in Axis}
        assert forces == {axis: 50 if axis is Axis.ZED else 40 for axis in Axis}  # 7, after 22
        assert await bench.arm.read_parameter(Axis.YAW, Parameter.ERROR_LIMIT) == 1000


@pytest.mark.parametrize("speed", [pytest.param(1.0, marks=pytest.mark.slow), 10.0])
async def test_homing_and_a_move_at_the_speeds_of_cells(speed: float) -> None:
    async with arm_bench(speed=speed, seed=3) as bench:
        await bench.homed()
        await bench.arm.move_counts({Axis.SHOULDER: 600, Axis.WRIST1: -300, Axis.WRIST2: -300})
        true = bench.true_counts()
        assert true[Axis.SHOULDER] == pytest.approx(600, abs=ARRIVAL_TOLERANCE + LABEL_TOLERANCE)
        assert true[Axis.WRIST1] == pytest.approx(-300, abs=ARRIVAL_TOLERANCE + LABEL_TOLERANCE)
        gaps_s = [b.at_s - a.at_s for a, b in pairwise(bench.trace)]
        assert min(gaps_s) >= 0.008  # §1.2, start to start, on the cell's clock


async def test_homing_that_is_cancelled_leaves_an_arm_at_rest_and_not_homed(
    bench: ArmBench,
) -> None:
    await bench.arm.connect()
    await bench.arm.enable_power()
    home = asyncio.create_task(bench.arm.home())
    await bench.moving()
    bench.forget()
    home.cancel()
    with pytest.raises(asyncio.CancelledError):
        await home
    assert bench.stopped_ips == {0, 1}
    assert await is_at_rest(bench)
    assert not bench.arm.is_homed


# ---- moving --------------------------------------------------------------------------------------
def random_targets(rng: np.random.Generator) -> dict[Axis, int]:
    """Counts inside all limits of §5.2, the combined ones included."""
    elbow = int(rng.integers(-2500, 2100))
    pitch, roll = int(rng.integers(-2600, 100)), int(rng.integers(-3500, 4800))
    return {
        Axis.SHOULDER: int(rng.integers(-2600, 2600)),
        Axis.ELBOW: elbow,
        Axis.YAW: elbow // 3 + int(rng.integers(-1000, 1000)),
        Axis.ZED: int(rng.integers(-3250, -50)),
        Axis.WRIST1: (pitch + roll) // 2,
        Axis.WRIST2: (pitch - roll) // 2,
    }


async def test_joint_moves_end_where_they_were_sent(homed: ArmBench) -> None:
    rng = np.random.default_rng(4)
    order = [Axis.ELBOW, Axis.SHOULDER, Axis.ZED, Axis.WRIST1, Axis.WRIST2, Axis.YAW]
    for _ in range(4):
        targets = random_targets(rng)
        q = kinematics.counts_to_q([targets[axis] for axis in order])
        await homed.arm.move_joints(q, speed=150)
        true = homed.true_counts()
        assert {a: true[a] for a in targets} == pytest.approx(targets, abs=ARRIVAL_TOLERANCE)
        assert await homed.arm.read_counts() == pytest.approx(true, abs=1)
    assert not homed.refused()


async def arrivals_s(bench: ArmBench, targets: Mapping[Axis, int]) -> dict[Axis, float]:
    """Return when each axis comes to its target [world s]; runs until it is cancelled."""
    arrived: dict[Axis, float] = {}
    while True:
        for axis, counts in bench.true_counts().items():
            if axis in targets and axis not in arrived and abs(counts - targets[axis]) < 5:
                arrived[axis] = bench.lived_s
        if len(arrived) == len(targets):
            return arrived
        await asyncio.sleep(0.001)


async def test_axes_of_a_joint_move_arrive_together() -> None:
    """§8.13: speeds are scaled so that all finish at once; without that, they do not."""
    order = [Axis.ELBOW, Axis.SHOULDER, Axis.ZED, Axis.WRIST1, Axis.WRIST2, Axis.YAW]
    targets = dict(zip(order, (-1800, 2400, -900, -1300, -700, -300), strict=True))
    async with arm_bench(speed=10.0) as bench:
        await bench.as_if_homed()
        watch = asyncio.create_task(arrivals_s(bench, targets))
        started_s = bench.lived_s
        await bench.arm.move_joints(kinematics.counts_to_q([targets[axis] for axis in order]))
        together = await watch
        away = dict.fromkeys(order, 0) | {
            Axis.ZED: -20
        }  # §5.2: the last counts to the top are taboo
        await bench.arm.move_counts(away, speeds=dict.fromkeys(order, 150))
        watch = asyncio.create_task(arrivals_s(bench, targets))
        await bench.arm.move_counts(targets, speeds=dict.fromkeys(order, 100))
        apart = await watch
    spread_s = max(together.values()) - min(together.values())
    longest_s = max(together.values()) - started_s
    assert longest_s > 2400 / 672  # 7: the shoulder's nominal speed
    assert spread_s < 0.9  # SPEED is a whole number, and IP0 starts one hand-over later
    assert max(apart.values()) - min(apart.values()) > 2.0


async def test_a_move_to_where_the_arm_is_sends_no_go(homed: ArmBench) -> None:
    await homed.arm.move_counts({Axis.SHOULDER: 300})
    homed.forget()
    await homed.arm.move_counts({Axis.SHOULDER: 300})
    assert not [x for x in homed.trace if x.request[0] in range(0xA0, 0xC0)]


@pytest.mark.parametrize("kind", [Stop.DEAD, Stop.RAMP, Stop.FREE])
async def test_a_stop_in_mid_move_stops_and_the_arm_still_knows_where_it_is(
    homed: ArmBench, kind: Stop
) -> None:
    move = asyncio.create_task(
        homed.arm.move_counts({Axis.SHOULDER: 2600, Axis.WRIST1: -2600, Axis.ZED: -3000})
    )
    await homed.moving()
    await homed.arm.stop(kind)
    with pytest.raises(MotionStoppedError):
        await move
    await homed.pass_time(1.0)  # the ramp
    assert await is_at_rest(homed)
    true = homed.true_counts()
    assert true[Axis.SHOULDER] < 2500
    assert homed.arm.is_homed
    assert await homed.arm.read_counts() == pytest.approx(true, abs=1)
    if kind is Stop.FREE:
        with pytest.raises(PowerOffError):
            await homed.arm.move_counts({Axis.SHOULDER: 0})
        await homed.arm.enable_power()
    await homed.arm.move_counts({Axis.SHOULDER: 100})
    assert homed.true_counts()[Axis.SHOULDER] == pytest.approx(100, abs=ARRIVAL_TOLERANCE)


async def test_a_ramp_stop_is_told_once_the_arm_rests(homed: ArmBench) -> None:
    move = asyncio.create_task(homed.arm.move_counts({Axis.SHOULDER: 2600, Axis.ZED: -3000}))
    await homed.moving()
    await homed.arm.stop(Stop.RAMP)
    still = homed.true_counts()
    with pytest.raises(MotionStoppedError):
        await move
    await homed.pass_time(1.0)
    # the servo's last count: a ramp under way would be tens of counts on
    assert homed.true_counts() == pytest.approx(still, abs=ARRIVAL_TOLERANCE)


async def test_a_pause_of_the_host_is_no_time_that_the_arm_has_lived(bench: ArmBench) -> None:
    before_s = bench.lived_s
    passing = asyncio.create_task(bench.pass_time(1.0))
    await asyncio.sleep(0)
    time.sleep(0.1)  # noqa: ASYNC251 -- the host's pause: 3 s by the clock at this speed
    await passing
    assert bench.lived_s - before_s >= 1.0


async def test_a_cancelled_move_stops_the_metal_before_it_ends(homed: ArmBench) -> None:
    move = asyncio.create_task(homed.arm.move_counts({Axis.ELBOW: 2000, Axis.WRIST2: -2000}))
    await homed.moving()
    homed.forget()
    move.cancel()
    with pytest.raises(asyncio.CancelledError):
        await move
    assert homed.stopped_ips == {0, 1}
    assert await is_at_rest(homed)
    await homed.arm.move_counts({Axis.ELBOW: 0, Axis.WRIST2: 0})
    assert homed.true_counts() == pytest.approx(PARK, abs=ARRIVAL_TOLERANCE)


async def test_closing_the_driver_in_mid_move_stops_the_metal(homed: ArmBench) -> None:
    move = asyncio.create_task(homed.arm.move_counts({Axis.SHOULDER: 2600}))
    await homed.moving()
    await homed.arm.aclose()
    with pytest.raises((MotionStoppedError, LinkError)):
        await move
    assert await is_at_rest(homed)


# ---- gripping ------------------------------------------------------------------------------------
async def test_a_part_is_gripped_held_and_its_loss_is_found_by_gripping_again(
    homed: ArmBench,
) -> None:
    arm, model = homed.arm, homed.model
    assert await arm.open_jaws() == pytest.approx(85.5, abs=0.5)  # §5.5, LHS fit at +1200
    model.grasp_limit_mm = 30.0
    assert await arm.grasp(force=30) == pytest.approx(30.0, abs=0.5)
    assert model.jaw_force_fraction == pytest.approx(0.3)  # MAX_FORCE of 100
    await arm.move_counts(
        {Axis.ZED: -600, Axis.SHOULDER: 200}
    )  # its mark in the status is no stall
    assert await arm.read_opening_mm() == pytest.approx(30.0, abs=0.5)
    assert await arm.grasp(force=30) == pytest.approx(30.0, abs=0.5)
    model.grasp_limit_mm = None
    assert await arm.grasp(force=30) == pytest.approx(0.0, abs=0.2)  # near 0: nothing is held


async def test_jaws_move_to_a_width_and_open_again_after_a_grip(homed: ArmBench) -> None:
    assert await homed.arm.move_gripper_mm(50.0) == pytest.approx(50.0, abs=0.4)
    assert homed.model.joints().jaw_opening_mm == pytest.approx(50.0, abs=0.4)
    homed.model.grasp_limit_mm = 42.0
    assert await homed.arm.grasp(force=20) == pytest.approx(42.0, abs=0.5)
    assert await homed.arm.move_gripper_mm(60.0) == pytest.approx(60.0, abs=0.4)
    homed.model.grasp_limit_mm = None
    assert await homed.arm.close_jaws() == pytest.approx(0.0, abs=0.4)


async def test_jaws_that_meet_something_on_the_way_to_a_width_say_so(homed: ArmBench) -> None:
    await homed.arm.move_gripper_mm(60.0)
    homed.model.grasp_limit_mm = 35.0
    with pytest.raises(AxisStalledError, match="gripper stalled"):
        await homed.arm.move_gripper_mm(10.0)
    assert homed.model.joints().jaw_opening_mm == pytest.approx(35.0, abs=0.2)


def test_both_sides_name_the_same_axes() -> None:
    assert len(set(EMULATED.values())) == len(Axis) == 7
