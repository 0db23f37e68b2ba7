"""Every fault of umi_rtx.md 7 on a real line: no unintended motion, no invented position.

"Acceptance for the driver: passes every one of those without moving anything unintended, and never
reports a joint position as valid after 0E/0F."

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import random
from collections.abc import AsyncIterator, Awaitable, Callable

import pytest
from cross_bench import nothing_is_left, open_fds
from umi_bench import ArmBench, arm_bench

from drivers.errors import (
    BadReplyError,
    DeviceError,
    LinkError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    WrongDeviceError,
)
from drivers.umi_scara import (
    Axis,
    AxisStalledError,
    HomingError,
    Ip,
    PowerOffError,
    WireExchange,
)
from drivers.umi_scara.protocol.constants import StatusBits
from emulators.umi_scara import ArmWire
from emulators.umi_scara import Axis as EmulatedAxis

ARRIVAL_TOLERANCE = 4  # DEAD_BAND and the driver's slack of 2
AT_REST = 0.5


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@pytest.fixture
async def cold() -> AsyncIterator[ArmBench]:
    async with arm_bench() as bench:
        yield bench


@pytest.fixture
async def impatient() -> AsyncIterator[ArmBench]:
    async with arm_bench(line="socket") as bench:
        yield bench


@pytest.fixture
async def homed(cold: ArmBench) -> ArmBench:
    return await cold.as_if_homed()


async def no_position_is_reported(bench: ArmBench) -> None:
    """After 0E or 0F nothing may look like a position, whoever asks, and nothing may move."""
    assert not bench.arm.is_homed
    for ask in (bench.arm.read_counts, bench.arm.read_q, bench.arm.read_opening_mm):
        with pytest.raises(PositionLostError):
            await ask()
    before = bench.true_counts()
    moves: list[Callable[[], Awaitable[object]]] = [
        lambda: bench.arm.move_counts({Axis.SHOULDER: 100}),
        lambda: bench.arm.grasp(force=20),
        bench.arm.home,
        bench.arm.enable_power,
    ]
    for move in moves:
        with pytest.raises((PositionLostError, PowerOffError)):
            await move()
    await bench.pass_time(1.0)
    assert bench.true_counts() == pytest.approx(before, abs=AT_REST)


# ---- the line ------------------------------------------------------------------------------------
LINE_FAULTS: dict[str, Callable[[ArmWire], None]] = {
    "first byte lost": lambda wire: setattr(wire.faults, "drop_reply_byte", 0),
    "second byte lost": lambda wire: setattr(wire.faults, "drop_reply_byte", 1),
    "third byte lost": lambda wire: setattr(wire.faults, "drop_reply_byte", 2),
    "a bit of a read flipped": lambda wire: setattr(wire.faults, "corrupt_next_read", True),
    "a bit of a write flipped": lambda wire: setattr(wire.faults, "corrupt_next_write", True),
    "replies 50 ms late": lambda wire: setattr(wire.faults, "reply_delay_s", 0.05),
}


@pytest.mark.parametrize("fault", LINE_FAULTS)
async def test_opening_comes_through_a_fault_of_the_line(impatient: ArmBench, fault: str) -> None:
    before = impatient.true_counts()
    LINE_FAULTS[fault](impatient.wire)
    identity = await impatient.arm.connect()
    await impatient.arm.enable_power()
    assert identity.restarted_ips <= {Ip.WRIST, Ip.ARM}
    assert impatient.model.power_on == [True, True]
    assert impatient.true_counts() == before


@pytest.mark.parametrize("fault", LINE_FAULTS)
async def test_a_move_comes_through_a_fault_of_the_line(impatient: ArmBench, fault: str) -> None:
    await impatient.as_if_homed()
    LINE_FAULTS[fault](impatient.wire)
    targets = {Axis.SHOULDER: 500, Axis.WRIST1: -300, Axis.WRIST2: -400}
    await impatient.arm.move_counts(targets)
    expected = dict.fromkeys(Axis, 0) | {Axis.ZED: -18} | targets
    assert impatient.true_counts() == pytest.approx(expected, abs=ARRIVAL_TOLERANCE)
    assert await impatient.arm.read_counts() == pytest.approx(impatient.true_counts(), abs=1)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 12))]
)
async def test_a_storm_on_the_line_moves_nothing_that_was_not_asked_for(
    impatient: ArmBench, seed: int
) -> None:
    """A fault every few exchanges: moves arrive or fail by a typed error; never elsewhere."""
    await impatient.as_if_homed()
    rng = random.Random(seed)
    faults = [act for name, act in LINE_FAULTS.items() if "late" not in name]

    def strike(_: WireExchange) -> None:
        if rng.random() < 0.04:
            rng.choice(faults)(impatient.wire)

    impatient.on_exchange = strike
    for _ in range(4):
        start = impatient.true_counts()[Axis.SHOULDER]
        shoulder, wrist = rng.randrange(-900, 900), rng.randrange(-600, -20)
        targets = {Axis.SHOULDER: shoulder, Axis.WRIST1: wrist, Axis.WRIST2: wrist}
        try:
            await impatient.arm.move_counts(targets)
        except PositionLostError:
            raise  # no board has restarted
        except DeviceError:
            await impatient.arm.stop()
        else:
            true = impatient.true_counts()
            assert {a: true[a] for a in targets} == pytest.approx(targets, abs=ARRIVAL_TOLERANCE)
        true = impatient.true_counts()
        low, high = sorted((start, shoulder))
        assert low - ARRIVAL_TOLERANCE <= true[Axis.SHOULDER] <= high + ARRIVAL_TOLERANCE
        still = {a: true[a] for a in (Axis.ELBOW, Axis.ZED, Axis.YAW, Axis.GRIPPER)}
        assert still == pytest.approx(dict.fromkeys(still, 0) | {Axis.ZED: -18}, abs=AT_REST)
    impatient.on_exchange = None
    assert await impatient.arm.read_counts() == pytest.approx(impatient.true_counts(), abs=1)


@pytest.mark.slow
async def test_homing_comes_through_a_storm_on_the_line() -> None:
    async with arm_bench(seed=4, line="socket") as bench:
        await bench.arm.connect()
        await bench.arm.enable_power()
        home = asyncio.create_task(bench.arm.home())
        for act in LINE_FAULTS.values():
            await bench.moving()
            act(bench.wire)
        await home
        assert bench.true_counts() == pytest.approx(await bench.arm.read_counts(), abs=4)


# ---- boards --------------------------------------------------------------------------------------
@pytest.mark.parametrize("code", [0x0E, 0x0F])
@pytest.mark.parametrize("ip", [0, 1])
async def test_a_board_that_restarts_in_mid_move_stops_all_and_voids_all(
    homed: ArmBench, ip: int, code: int
) -> None:
    homed.wire.faults.restart_code = code
    move = asyncio.create_task(homed.arm.move_counts({Axis.SHOULDER: 2500, Axis.WRIST1: -2500}))
    await homed.moving()
    homed.wire.restart(ip)
    with pytest.raises(PositionLostError):
        await move
    await no_position_is_reported(homed)
    identity = await homed.arm.connect()
    # the halt had to give GO to a restarted board, or the other one could not have been stopped
    assert identity.restarted_ips <= {Ip(ip)}
    with pytest.raises(PositionLostError, match="not homed"):
        await homed.arm.read_counts()


@pytest.mark.parametrize("ip", [0, 1])
async def test_a_board_that_restarts_at_rest_is_found_by_the_next_look(
    homed: ArmBench, ip: int
) -> None:
    homed.wire.restart(ip)
    with pytest.raises(PositionLostError):
        await homed.arm.read_counts()
    await no_position_is_reported(homed)


async def test_an_arm_that_lost_its_power_is_opened_and_homed_again(cold: ArmBench) -> None:
    await cold.as_if_homed()
    cold.wire.power_cycle(listening=1)
    with pytest.raises(PositionLostError):
        await cold.arm.move_counts({Axis.SHOULDER: 300})
    await cold.homed()
    assert cold.true_counts() == pytest.approx(await cold.arm.read_counts(), abs=4)


@pytest.mark.parametrize("verb", ["home", "grip"])
async def test_a_restart_ends_every_verb(cold: ArmBench, verb: str) -> None:
    if verb == "grip":
        await cold.as_if_homed()
        await cold.arm.open_jaws()
        running = asyncio.create_task(cold.arm.grasp(force=30))
    else:
        await cold.arm.connect()
        await cold.arm.enable_power()
        running = asyncio.create_task(cold.arm.home())  # type: ignore[arg-type]  # result unused
    await cold.moving()
    cold.wire.restart(1)
    with pytest.raises(PositionLostError):
        await running
    await no_position_is_reported(cold)


@pytest.mark.parametrize("dead", [[0], [1], [0, 1]], ids=["IP0", "IP1", "both"])
async def test_dead_boards_are_told_with_what_to_check(
    impatient: ArmBench, dead: list[int]
) -> None:
    before = impatient.true_counts()
    for ip in dead:
        impatient.wire.kill(ip)
    with pytest.raises(LinkError, match="check power, cable, boards"):
        await impatient.arm.connect()
    assert impatient.true_counts() == before


@pytest.mark.parametrize("dead", [pytest.param(0, marks=pytest.mark.slow), 1])
async def test_a_board_that_dies_in_mid_move_ends_the_move(impatient: ArmBench, dead: int) -> None:
    await impatient.as_if_homed()
    move = asyncio.create_task(impatient.arm.move_counts({Axis.SHOULDER: 2500, Axis.WRIST1: -2500}))
    await impatient.moving()
    impatient.wire.kill(dead)
    with pytest.raises((LinkError, PositionLostError)):
        await move
    if dead != impatient.wire.listening:
        await impatient.pass_time(0.5)
        still = impatient.true_counts()
        await impatient.pass_time(1.0)
        assert impatient.true_counts() == pytest.approx(still, abs=AT_REST)
    with pytest.raises(DeviceError):  # no position of a half-dead arm
        await impatient.arm.read_counts()


async def test_a_strange_rom_is_refused_and_not_talked_to_for_ever(cold: ArmBench) -> None:
    cold.wire.faults.monitor_rom = True
    with pytest.raises(WrongDeviceError, match="unsupported ROM"):
        await cold.arm.connect()
    assert len(cold.trace) < 10


@pytest.mark.parametrize("listening", [0, 1])
async def test_automatic_toggling_left_on_is_switched_off(listening: int) -> None:
    async with arm_bench(listening=listening) as bench:
        bench.wire.run_warm(auto_toggle=True)
        await bench.arm.connect()
        assert [ip.auto_toggle for ip in bench.wire.ips] == [False, False]
        # in step: each board answers for its own motors, and all of them were stopped on opening
        stopped = dict.fromkeys(Axis, StatusBits.STOPPED)
        assert {a: await bench.arm.status(a) for a in Axis} == stopped


@pytest.mark.parametrize("hands_over", [False, True])
@pytest.mark.parametrize("ip", list(Ip))
async def test_a_reset_that_may_hand_the_line_over_loses_nobody(
    homed: ArmBench, ip: Ip, hands_over: bool
) -> None:
    """§1.5: `20` may hand over or not; somebody below the verbs sends one."""
    homed.wire.faults.reset_toggles = hands_over
    await homed.arm.axes.link.exchange(ip, b"\x20")
    with pytest.raises((PositionLostError, BadReplyError)):
        await homed.arm.read_counts()
    identity = await homed.arm.connect()
    assert identity.restarted_ips <= {ip}
    assert set(identity.rom_versions) == set(Ip)
    with pytest.raises(PositionLostError):
        await homed.arm.read_counts()


# ---- the body ------------------------------------------------------------------------------------
@pytest.mark.parametrize("axis", [Axis.SHOULDER, Axis.ZED, Axis.WRIST1])
async def test_a_blocked_axis_is_named_and_everything_stops(homed: ArmBench, axis: Axis) -> None:
    homed.model.jam(EmulatedAxis[axis.name])
    targets = {Axis.ELBOW: 1500, Axis.YAW: 500, axis: -800}
    with pytest.raises(AxisStalledError, match=axis.name.lower()) as failure:
        await homed.arm.move_counts(targets)
    assert failure.value.got_counts == pytest.approx(homed.true_counts()[axis], abs=1)
    assert homed.stopped_ips == {0, 1}
    still = homed.true_counts()
    await homed.pass_time(1.0)
    assert homed.true_counts() == pytest.approx(still, abs=AT_REST)
    homed.model.jam(EmulatedAxis[axis.name], False)
    await homed.arm.move_counts(targets)
    true = homed.true_counts()
    assert {a: true[a] for a in targets} == pytest.approx(targets, abs=ARRIVAL_TOLERANCE)


async def test_an_axis_that_is_jammed_from_the_start_is_homed_where_it_is_or_not_at_all(
    cold: ArmBench,
) -> None:
    """Stalls are all that homing sees (4); the way to the park finds out what it labels wrongly."""
    cold.model.jam(EmulatedAxis.ELBOW)
    await cold.arm.connect()
    await cold.arm.enable_power()
    with pytest.raises((AxisStalledError, HomingError)):
        await cold.arm.home()
    assert not cold.arm.is_homed


async def test_an_emergency_stop_in_mid_move_ends_it_and_wants_power_anew(homed: ArmBench) -> None:
    arm, model = homed.arm, homed.model
    assert await arm.read_motor_supply()
    move = asyncio.create_task(arm.move_counts({Axis.SHOULDER: 2500, Axis.WRIST1: -2500}))
    await homed.moving()
    model.press_estop()
    with pytest.raises(AxisStalledError):
        await move
    assert not await arm.read_motor_supply()
    still = homed.true_counts()
    assert still[Axis.SHOULDER] < 2400
    with pytest.raises(AxisStalledError, match="motor power"):
        await arm.move_counts({Axis.ELBOW: 300})
    model.release_estop()
    await homed.pass_time(1.0)
    assert homed.true_counts() == pytest.approx(still, abs=AT_REST)  # nothing resumes by itself
    with pytest.raises(AxisStalledError, match="motor power"):
        await arm.move_counts({Axis.ELBOW: 300})
    await arm.enable_power()
    assert await arm.read_counts() == pytest.approx(still, abs=1)  # the boards lived on
    await arm.move_counts({Axis.SHOULDER: 0, Axis.WRIST1: 0})
    assert homed.true_counts()[Axis.SHOULDER] == pytest.approx(0, abs=ARRIVAL_TOLERANCE)


async def test_a_go_that_is_always_busy_is_given_up_and_nothing_has_moved(
    impatient: ArmBench,
) -> None:
    await impatient.as_if_homed()
    impatient.wire.faults.sticky_busy = True
    before = impatient.true_counts()
    with pytest.raises(RefusedError, match="busy") as refusal:
        await impatient.arm.move_counts({Axis.SHOULDER: 500})
    assert refusal.value.code == 0x03
    assert impatient.true_counts() == pytest.approx(before, abs=AT_REST)
    impatient.wire.faults.sticky_busy = False
    await impatient.arm.move_counts({Axis.SHOULDER: 500})
    assert impatient.true_counts()[Axis.SHOULDER] == pytest.approx(500, abs=ARRIVAL_TOLERANCE)


async def test_a_line_that_is_pulled_is_told(homed: ArmBench) -> None:
    move = asyncio.create_task(homed.arm.move_counts({Axis.SHOULDER: 2500}))
    await homed.moving()
    await homed.server.aclose()
    with pytest.raises(LinkError) as failure:
        await move
    assert not isinstance(failure.value, ReplyTimeoutError)
