"""The arm's methods against a small arm on the other end: what moves, is refused, and stops.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import dataclasses
import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from umi_fakes import FakeArm, FakeClock, as_text, contains, once, only_asks, shows

from drivers.errors import LinkError, PositionLostError, RefusedError
from drivers.umi_scara import (
    ArmConfig,
    Axis,
    AxisStalledError,
    GripperLaw,
    HomingConfig,
    HomingError,
    Ip,
    MotionStoppedError,
    OutOfRangeError,
    Parameter,
    PowerOffError,
    Stop,
    UmiScara,
    UmiSettings,
    WireExchange,
    kinematics,
    synchronised_speeds,
)

GOLDEN = tomllib.loads(
    (Path(__file__).parents[1] / "golden" / "umi_rtx.toml").read_text(encoding="utf-8")
)
ADDRESSES = {  # umi_rtx.md 1.3
    Axis.ELBOW: (1, 0),
    Axis.SHOULDER: (1, 1),
    Axis.ZED: (1, 2),
    Axis.YAW: (1, 3),
    Axis.GRIPPER: (1, 4),
    Axis.WRIST1: (0, 2),
    Axis.WRIST2: (0, 3),
}


def session(name: str) -> list[tuple[str, str]]:
    found = next(s for s in GOLDEN["session"] if s["name"] == name)
    return [(x["request"], x["reply"]) for x in found["exchange"]]


def without_repeated_polls(trace: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """How often one polls is up to the host: keep the first of equal polls in a row.

    Bit 1 of a status carries no decision (§2.8); the reference marks these statuses as its choice.
    """
    kept: list[tuple[str, str]] = []
    for request, reply in trace:
        if request in ("12", "17"):  # of zed and of an IP; the others ask who else moves
            status = bytes.fromhex(reply)
            reply = bytes([status[0], status[1] & ~0x02, status[2]]).hex(" ").upper()
            if kept and kept[-1] == (request, reply):
                continue
        kept.append((request, reply))
    return kept


ROOT = Path(__file__).parents[2]


class Bench:
    def __init__(self, *, running: bool = False, config: ArmConfig | None = None) -> None:
        self.clock = FakeClock()
        self.wire = FakeArm(self.clock, running=running)
        self.trace: list[WireExchange] = []
        self.arm = UmiScara(
            lambda: self.wire, config=config, clock=self.clock, trace=self.trace.append
        )

    def forget(self) -> None:
        self.trace.clear()
        self.wire.heard.clear()
        self.wire.spoken.clear()

    async def homed(self) -> "Bench":
        await self.arm.connect()
        await self.arm.enable_power()
        await self.arm.home()
        for ip, ctl in ADDRESSES.values():  # room in all directions: limits are the driver's task
            motor = self.wire.motor(ip, ctl)
            motor.low, motor.high = -9000, 9000
        self.wire.motor(1, 4).low = -30
        self.forget()
        return self

    def requests(self) -> list[bytes]:
        return [data for _, data in self.wire.heard]

    def does(self) -> list[bytes]:
        """Requests that do more than ask."""
        return [data for data in self.requests() if not only_asks(data.hex())]

    def when(self, wanted: bytes, act: Callable[[], None]) -> None:
        """Do something right after the wire has carried a request."""

        def on_request(data: bytes) -> None:
            if data == wanted:
                self.wire.on_request = None
                act()

        self.wire.on_request = on_request

    def stops(self) -> set[int]:
        return {ip for ip, data in self.wire.heard if data == b"\x24"}


# ---- session and homing ------------------------------------------------------------------------
async def test_connecting_and_enabling_power_is_the_references_cold_open() -> None:
    bench = Bench()
    identity = await bench.arm.connect()
    await bench.arm.enable_power()
    # the jaws and a stop first; a restarted board takes neither
    assert shows(as_text(bench.trace), session("cold open"))
    assert identity.rom_versions == {Ip.WRIST: (2, 3), Ip.ARM: (2, 3)}
    assert identity.was_restarted
    assert not bench.arm.is_homed


async def test_homing_holds_the_references_sessions() -> None:
    bench = Bench()
    await bench.arm.connect()
    await bench.arm.enable_power()
    await bench.arm.home()
    trace = without_repeated_polls(as_text(bench.trace))
    zed = without_repeated_polls(session("home one axis: zed"))
    assert contains(trace, zed[:12])  # up to the stall; then the driver makes sure of it (§9.17)
    assert contains(trace, zed[12:])
    name = "end of homing: label the stop positions, go to the start pose"
    assert contains(trace, without_repeated_polls(session(name)))
    assert bench.arm.is_homed


async def test_homing_labels_the_factory_stops_and_parks() -> None:
    bench = Bench()
    starts = [300, -500, -200, 70, 50, 80, -90]
    for (ip, ctl), start in zip(ADDRESSES.values(), starts, strict=True):
        bench.wire.motor(ip, ctl).counts = start
    await bench.arm.connect()
    await bench.arm.enable_power()
    await bench.arm.home()
    # the stop that an axis was driven against now reads as in §4.2
    assert bench.wire.motor(1, 2).high == 0
    assert bench.wire.motor(1, 1).high == 2630
    assert bench.wire.motor(1, 0).low == -2629
    assert bench.wire.motor(1, 3).low == -1947
    assert bench.wire.motor(1, 4).low == -30
    # the fake wrist stops up to one poll short of its stops: 3000 counts/s for 38 ms, two motors
    assert bench.wire.boards[0].wrist_low == pytest.approx([-3101 + 459, -3101 - 459], abs=240)
    assert await bench.arm.read_counts() == {axis: -18 if axis is Axis.ZED else 0 for axis in Axis}


async def test_homing_one_axis_that_never_stalls_times_out_and_stops() -> None:
    bench = Bench(config=ArmConfig(homing=HomingConfig(zed_timeout_s=5.0)))
    bench.wire.motor(1, 2).high = 10**6
    await bench.arm.connect()
    await bench.arm.enable_power()
    began_s = bench.clock.now_s()
    bench.forget()
    with pytest.raises(HomingError, match="zed found no stop within 5 s"):
        await bench.arm.home()
    assert bench.clock.now_s() - began_s < 7.0
    assert bench.does()[-4:] == [b"\x24", b"\x29", b"\x24", b"\x29"]  # and a look at the first
    assert not bench.arm.is_homed


async def test_a_stall_bit_of_an_axis_that_still_moves_is_no_stop_yet() -> None:
    bench = Bench()
    zed = bench.wire.motor(1, 2)
    await bench.arm.connect()
    await bench.arm.enable_power()
    seen: list[float] = []

    def early_stall(request: bytes, reply: bytes) -> list[tuple[float, bytes]] | None:
        if request == b"\x12" and not seen and zed.target is not None:
            return [(0.003, b"\x12\x09\x00")]
        if request == b"\x80\x00\x00" and bench.wire.heard[-1][0] == 1:
            seen.append(zed.counts)
        return None

    bench.wire.mishap = early_stall
    await bench.arm.home()
    assert seen[0] == 200.0  # the fake arm's top stop


async def test_relative_and_force_mode_left_behind_are_undone_before_homing() -> None:
    bench = Bench(running=True)
    await bench.arm.connect()
    await bench.arm.enable_power()
    bench.forget()
    bench.wire.mishap = once(b"\x13", lambda _: [(0.003, b"\x13\x30\x00")])
    await bench.arm.home()
    assert {b"\x1a\x03\x00", b"\x18\x03\x00"} <= set(bench.requests())


async def test_without_power_nothing_moves() -> None:
    bench = Bench()
    await bench.arm.connect()
    bench.forget()
    with pytest.raises(PowerOffError):
        await bench.arm.home()
    assert not bench.requests()


async def test_without_homing_no_move_and_no_position() -> None:
    bench = Bench(running=True)
    await bench.arm.connect()
    await bench.arm.enable_power()
    bench.forget()
    with pytest.raises(PositionLostError, match="not homed"):
        await bench.arm.move_counts({Axis.SHOULDER: 10})
    with pytest.raises(PositionLostError, match="not homed"):
        await bench.arm.read_counts()
    assert not bench.requests()


async def test_without_a_connection_nothing_works() -> None:
    bench = Bench()
    with pytest.raises(LinkError, match="not connected"):
        await bench.arm.read_parameter(Axis.ZED, Parameter.SPEED)


async def test_leaving_dead_stops_both_boards_and_closes_the_line() -> None:
    bench = Bench()
    async with bench.arm:
        bench.forget()
    assert bench.stops() == {0, 1}
    assert not bench.wire.is_open


# ---- moving ------------------------------------------------------------------------------------
async def test_a_move_arrives_and_says_where() -> None:
    bench = await Bench().homed()
    got = await bench.arm.move_counts({Axis.SHOULDER: 1000, Axis.WRIST1: -300, Axis.WRIST2: -300})
    assert got == {Axis.SHOULDER: 1000, Axis.WRIST1: -300, Axis.WRIST2: -300}
    assert bench.wire.motor(1, 1).counts == 1000
    assert (await bench.arm.read_counts())[Axis.WRIST2] == -300


async def test_a_move_of_one_joint_is_the_references_request() -> None:
    bench = await Bench().homed()
    await bench.arm.move_counts({Axis.SHOULDER: 1000})
    expected = [(q, a) for q, a in session("move one joint and poll: shoulder to +1000 counts")[:3]]
    assert contains(as_text(bench.trace), expected)


async def test_what_is_set_already_is_not_said_again() -> None:
    bench = await Bench().homed()
    await bench.arm.move_counts({Axis.SHOULDER: 1000, Axis.ELBOW: 500}, speeds={Axis.ELBOW: 70})
    bench.forget()
    await bench.arm.move_counts({Axis.SHOULDER: 1000, Axis.ELBOW: 700}, speeds={Axis.ELBOW: 70})
    writes = [data for data in bench.requests() if data[0] >> 3 == 0x78 >> 3]
    assert writes == [b"\x78" + (700).to_bytes(2, "little")]
    # the elbow; the shoulder is there and goes nowhere, but keeps A1 from being one bit off 21
    assert b"\xa3" in bench.requests()
    assert bench.wire.motor(1, 1).counts == 1000
    bench.forget()
    await bench.arm.move_counts({Axis.SHOULDER: 1000, Axis.ELBOW: 700})
    assert not bench.requests()


async def test_both_boards_start_within_two_requests() -> None:
    bench = await Bench().homed()
    await bench.arm.move_counts({Axis.ZED: -500, Axis.SHOULDER: 100, Axis.WRIST1: -50})
    requests = bench.requests()
    first = requests.index(b"\xa6") if b"\xa6" in requests else -1
    second = requests.index(b"\xa4")
    between = bench.requests()[min(first, second) + 1 : max(first, second)]
    assert [data for data in between if not only_asks(data.hex())] == [b"\x29"]


async def test_all_axes_arrive_together() -> None:
    bench = await Bench().homed()
    q = kinematics.counts_to_q([600, -1200, -400, -700, -500, 300])
    await bench.arm.move_joints(q)
    speeds = {
        axis: await bench.arm.read_parameter(axis, Parameter.SPEED)
        for axis in kinematics.COUNTS_ORDER
    }
    nominal = {  # umi_rtx.md 7
        Axis.ELBOW: 643,
        Axis.SHOULDER: 672,
        Axis.ZED: 412,
        Axis.WRIST1: 1400,
        Axis.WRIST2: 1400,
        Axis.YAW: 1071,
    }
    far = dict(zip(kinematics.COUNTS_ORDER, [600, 1200, 382, 700, 500, 300], strict=True))
    times_s = {axis: far[axis] / (nominal[axis] * speeds[axis] / 100) for axis in nominal}
    assert speeds[Axis.SHOULDER] == 100
    assert max(times_s, key=lambda axis: times_s[axis]) is Axis.SHOULDER
    for axis, time_s in times_s.items():  # a whole SPEED may be up to one too high
        assert times_s[Axis.SHOULDER] * (1 - 1 / speeds[axis]) <= time_s
    assert (await bench.arm.read_q()) == pytest.approx(q, abs=0.3)


def test_a_short_axis_still_gets_a_speed() -> None:
    nominal = {Axis.ZED: 400.0, Axis.YAW: 1000.0, Axis.ELBOW: 600.0}
    speeds = synchronised_speeds({Axis.ZED: -3000, Axis.YAW: 1, Axis.ELBOW: 0}, nominal, 80)
    assert speeds == {Axis.ZED: 80, Axis.YAW: 1}


LIMITS = [
    ({Axis.ZED: -19}, "zed"),
    ({Axis.ZED: -3304}, "zed"),
    ({Axis.SHOULDER: 2631}, "shoulder"),
    ({Axis.ELBOW: 2207}, "elbow"),
    ({Axis.YAW: 1072}, "yaw"),
    ({Axis.WRIST1: -2643}, "pitch"),
    ({Axis.WRIST1: 2442, Axis.WRIST2: -2441}, "roll"),
    ({Axis.GRIPPER: 1201}, "gripper"),
    ({Axis.GRIPPER: -31}, "gripper"),
]


@pytest.mark.parametrize(("targets", "name"), LIMITS)
async def test_beyond_a_limit_no_byte_goes_out(targets: dict[Axis, int], name: str) -> None:
    bench = await Bench().homed()
    with pytest.raises(OutOfRangeError, match=name) as refusal:
        await bench.arm.move_counts(targets)
    assert isinstance(refusal.value, ValueError)
    assert not bench.requests()
    assert bench.arm.is_homed


async def test_combined_limits_count_where_the_partner_stands() -> None:
    bench = await Bench().homed()
    await bench.arm.move_counts({Axis.YAW: -1000})
    with pytest.raises(OutOfRangeError, match="yaw"):
        await bench.arm.move_counts({Axis.ELBOW: 300})  # -1000 - 100 < -1071
    await bench.arm.move_counts({Axis.ELBOW: 300, Axis.YAW: -900})
    with pytest.raises(OutOfRangeError, match="yaw"):
        await bench.arm.move_counts({Axis.YAW: -1000})


async def test_leaving_the_park_does_not_trip_over_zed_above_its_limit() -> None:
    bench = await Bench().homed()  # zed parks at -18 (§4.1), above the software limit of -20
    await bench.arm.move_counts({Axis.SHOULDER: 100})
    assert bench.wire.motor(1, 1).counts == 100


async def test_a_stall_names_axis_asked_and_got_and_stops_both_boards() -> None:
    bench = await Bench().homed()
    bench.wire.motor(1, 1).high = 400
    with pytest.raises(AxisStalledError, match="shoulder stalled: 1000 counts required") as stall:
        await bench.arm.move_counts({Axis.SHOULDER: 1000, Axis.WRIST1: -2000})
    assert (stall.value.axis, stall.value.required_counts, stall.value.got_counts) == (
        Axis.SHOULDER,
        1000,
        400,
    )
    assert bench.stops() == {0, 1}
    assert bench.arm.is_homed  # where the arm is, is still known
    assert -2000 < bench.wire.motor(0, 2).counts < 0  # the wrist did not go on alone


async def test_an_axis_that_falls_behind_is_named() -> None:
    bench = await Bench().homed()
    bench.when(b"\xa2", lambda: setattr(bench.wire.motor(1, 1), "status", 0x06))
    with pytest.raises(AxisStalledError, match="shoulder fell behind"):
        await bench.arm.move_counts({Axis.SHOULDER: 2000})


async def test_motor_power_cut_behind_the_drivers_back_is_noticed() -> None:
    bench = await Bench().homed()
    bench.wire.motor(1, 1).powered = False  # acknowledged, and nothing happens (§8.10)
    with pytest.raises(AxisStalledError, match="is motor power on"):
        await bench.arm.move_counts({Axis.SHOULDER: 1000})


async def test_a_move_that_takes_too_long_is_stopped() -> None:
    bench = await Bench().homed()
    with pytest.raises(AxisStalledError, match=r"shoulder moves after 0\.5 s"):
        await bench.arm.move_counts({Axis.SHOULDER: 2000}, deadline_s=0.5)
    assert bench.stops() == {0, 1}
    assert bench.wire.motor(1, 1).target is None


async def test_busy_is_waited_for() -> None:
    bench = await Bench().homed()
    bench.wire.boards[1].busy_count = 5
    await bench.arm.move_counts({Axis.SHOULDER: 300})
    assert bench.requests().count(b"\xa2") == 6
    assert bench.wire.motor(1, 1).counts == 300


async def test_busy_for_ever_is_given_up() -> None:
    bench = await Bench().homed()
    bench.wire.boards[1].busy_count = 10**6
    with pytest.raises(RefusedError) as refusal:
        await bench.arm.move_counts({Axis.SHOULDER: 300})
    assert refusal.value.code == 0x03
    assert bench.stops() == {0, 1}


MISHAPS: dict[str, Callable[[bytes], list[tuple[float, bytes]]]] = {
    "lost": lambda _: [],
    "late": lambda reply: [(0.3, reply)],
    "long": lambda reply: [(0.003, reply + b"\x00")],
    "frame timeout": lambda _: [(0.011, b"\x0b")],
}


@pytest.mark.parametrize("mishap", MISHAPS)
@pytest.mark.parametrize("request_hex", ["70 03 00", "79 E8 03", "A2", "17", "49", "41", "29"])
async def test_a_move_comes_through_one_mishap_on_any_of_its_replies(
    mishap: str, request_hex: str
) -> None:
    bench = await Bench().homed()
    bench.wire.mishap = once(bytes.fromhex(request_hex), MISHAPS[mishap])
    got = await bench.arm.move_counts({Axis.SHOULDER: 1000, Axis.WRIST1: -100})
    assert got == {Axis.SHOULDER: 1000, Axis.WRIST1: -100}
    # the data of three bytes may have been taken for commands: then a stop comes before all else
    is_in_doubt = len(request_hex) == 8 and mishap in ("long", "frame timeout")
    assert bool(bench.stops()) is is_in_doubt


async def test_a_write_that_was_carried_out_is_read_back_and_not_repeated() -> None:
    bench = await Bench().homed()
    bench.wire.mishap = once(b"\x79\xe8\x03", lambda _: [])
    await bench.arm.move_counts({Axis.SHOULDER: 1000})
    assert bench.requests().count(b"\x79\xe8\x03") == 1
    assert b"\x60\x03\x00" in bench.requests()


async def test_a_go_that_was_carried_out_is_not_repeated() -> None:
    bench = await Bench().homed()
    bench.wire.mishap = once(b"\xa2", lambda _: [])
    await bench.arm.move_counts({Axis.SHOULDER: 2000})
    assert bench.requests().count(b"\xa2") == 1


# ---- stops, cancellation, restarts -------------------------------------------------------------
async def test_a_cancelled_move_sends_a_dead_stop_to_both_boards_before_it_ends() -> None:
    bench = await Bench().homed()
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: 2000}))
    bench.when(b"\x11", lambda: move.cancel() and None)
    with pytest.raises(asyncio.CancelledError):
        await move
    assert bench.does()[-4:] == [b"\x24", b"\x29", b"\x24", b"\x29"]  # and a look at the first
    assert bench.stops() == {0, 1}
    assert bench.wire.motor(1, 1).target is None


async def test_a_second_cancellation_does_not_cut_the_stop_short() -> None:
    bench = await Bench().homed()
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: 2000}))
    bench.when(b"\x11", lambda: move.cancel() and None)
    await bench.wire.spoken.wait()
    while b"\x24" not in bench.requests():
        bench.wire.spoken.clear()
        await bench.wire.spoken.wait()
    move.cancel()
    with pytest.raises(asyncio.CancelledError):
        await move
    assert bench.stops() == {0, 1}


async def test_a_move_cancelled_by_a_time_out_stops_too() -> None:
    bench = await Bench().homed()
    bench.when(b"\x11", lambda: task.cancel() and None)

    async def work() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(bench.arm.move_counts({Axis.SHOULDER: 2000}))

    task = asyncio.create_task(work())
    with pytest.raises(asyncio.CancelledError):
        await task
    assert bench.stops() == {0, 1}


@pytest.mark.parametrize(
    ("kind", "byte"), [(Stop.DEAD, 0x24), (Stop.RAMP, 0x25), (Stop.FREE, 0x26)]
)
async def test_a_stop_reaches_both_boards_and_ends_the_running_move(kind: Stop, byte: int) -> None:
    bench = await Bench().homed()
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: 2000, Axis.WRIST1: -900}))
    while b"\xa2" not in bench.requests():
        bench.wire.spoken.clear()
        await bench.wire.spoken.wait()
    await bench.arm.stop(kind)
    with pytest.raises(MotionStoppedError):
        await move
    stops = [(ip, data[0]) for ip, data in bench.wire.heard if data[0] in (0x24, 0x25, 0x26)]
    assert sorted(stops) == [(0, byte), (1, byte)]  # and no dead stop on top of a ramp
    assert bench.wire.motor(1, 1).target is None
    assert bench.arm.is_powered is (kind is not Stop.FREE)
    assert bench.arm.is_homed


async def test_after_a_stop_nothing_is_taken_to_be_where_it_was() -> None:
    bench = await Bench().homed()
    await bench.arm.move_counts({Axis.SHOULDER: 1000})
    await bench.arm.stop(Stop.FREE)
    bench.wire.motor(1, 1).counts = 700.0  # somebody moves the arm by hand
    assert (await bench.arm.read_counts())[Axis.SHOULDER] == 700
    await bench.arm.enable_power()
    assert await bench.arm.move_counts({Axis.SHOULDER: 1000}) == {Axis.SHOULDER: 1000}
    assert bench.wire.motor(1, 1).counts == 1000


async def test_a_stop_before_the_go_keeps_the_go_from_going_out() -> None:
    bench = await Bench().homed()
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: 2000}))
    await bench.wire.spoken.wait()  # the first frame of the first parameter
    await bench.arm.stop()
    with pytest.raises(MotionStoppedError):
        await move
    assert not any(data[0] >> 5 == 0b101 for data in bench.requests())


async def test_a_stop_purges_the_motions_that_wait() -> None:
    bench = await Bench().homed()
    moves = [
        asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: counts}))
        for counts in (2000, -2000)
    ]
    await bench.wire.spoken.wait()
    await bench.arm.stop()
    results = await asyncio.gather(*moves, return_exceptions=True)
    assert [type(result) for result in results] == [MotionStoppedError, MotionStoppedError]
    assert abs(bench.wire.motor(1, 1).counts) < 100
    await bench.arm.move_counts({Axis.SHOULDER: 50})  # and the arm is free again
    assert bench.wire.motor(1, 1).counts == 50


async def test_a_stop_ends_homing() -> None:
    bench = Bench()
    await bench.arm.connect()
    await bench.arm.enable_power()
    home = asyncio.create_task(bench.arm.home())
    while b"\x80\x10\x00" not in bench.requests():
        bench.wire.spoken.clear()
        await bench.wire.spoken.wait()
    await bench.arm.stop()
    with pytest.raises(MotionStoppedError):
        await home
    assert not bench.arm.is_homed
    assert bench.wire.motor(1, 2).target is None


@pytest.mark.parametrize("board", [0, 1])
async def test_a_restart_in_mid_move_loses_every_position(board: int) -> None:
    bench = await Bench().homed()
    bench.when(b"\x11", lambda: bench.wire.boards[board].restart())
    with pytest.raises(PositionLostError):
        await bench.arm.move_counts({Axis.SHOULDER: 2000, Axis.WRIST1: -2000})
    assert bench.stops() == {0, 1}
    for ip, ctl in ADDRESSES.values():
        assert bench.wire.motor(ip, ctl).target is None
    assert not bench.arm.is_homed
    assert bench.arm.identity is None
    bench.forget()
    for verb in (
        bench.arm.read_counts,
        bench.arm.read_q,
        bench.arm.read_opening_mm,
        bench.arm.home,
        bench.arm.enable_power,
    ):
        with pytest.raises(PositionLostError):
            await verb()
    with pytest.raises(PositionLostError):
        await bench.arm.move_counts({Axis.SHOULDER: 0})
    assert not bench.requests()


async def test_after_a_restart_the_way_back_is_connect_power_home() -> None:
    bench = await Bench().homed()
    bench.wire.boards[1].restart()
    with pytest.raises(PositionLostError):
        await bench.arm.read_counts()
    identity = await bench.arm.connect()
    assert identity.restarted_ips == {Ip.ARM}
    await bench.arm.enable_power()
    await bench.arm.home()
    assert (await bench.arm.read_counts())[Axis.ZED] == -18


async def test_a_new_connection_to_a_running_arm_still_wants_homing() -> None:
    bench = await Bench().homed()
    identity = await bench.arm.connect()
    assert not identity.was_restarted
    assert not bench.arm.is_homed
    assert not bench.arm.is_powered


# ---- parameters --------------------------------------------------------------------------------
async def test_speed_and_force_reach_the_motor() -> None:
    bench = await Bench().homed()
    await bench.arm.set_speed(Axis.WRIST2, 60)
    await bench.arm.set_force(Axis.YAW, 25)
    assert bench.wire.motor(0, 3).parameters[4] == 60
    assert bench.wire.motor(1, 3).parameters[10] == 25
    assert await bench.arm.read_parameter(Axis.YAW, Parameter.MAX_FORCE) == 25


@pytest.mark.parametrize("speed", [0, -1, 161])
async def test_a_speed_nobody_has_ever_used_is_refused(speed: int) -> None:
    bench = await Bench().homed()
    with pytest.raises(ValueError, match="SPEED"):
        await bench.arm.set_speed(Axis.ZED, speed)
    with pytest.raises(ValueError, match="SPEED"):
        await bench.arm.move_counts({Axis.ZED: -100}, speeds={Axis.ZED: speed})
    assert not bench.requests()


async def test_positions_are_labelled_by_homing_alone() -> None:
    bench = await Bench().homed()
    with pytest.raises(ValueError, match="CURRENT_POSITION"):
        await bench.arm.write_parameter(Axis.ZED, Parameter.CURRENT_POSITION, 0)
    with pytest.raises(ValueError, match="CURRENT_FORCE"):
        await bench.arm.write_parameter(Axis.ZED, Parameter.CURRENT_FORCE, 0)


# ---- gripper -----------------------------------------------------------------------------------
async def test_a_grip_ends_where_the_part_is() -> None:
    bench = await Bench().homed()
    assert await bench.arm.open_jaws() == pytest.approx(85.5, abs=0.05)  # §5.5, n = 1200
    bench.wire.motor(1, 4).low = 600  # the part
    assert await bench.arm.grasp(force=30) == pytest.approx(38.9, abs=0.05)  # §5.5, n = 600
    assert bench.wire.motor(1, 4).parameters[10] == 30
    assert await bench.arm.read_opening_mm() == pytest.approx(38.9, abs=0.05)


async def test_jaws_that_feel_for_something_close_slowly_and_are_given_the_time() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).low = 600
    usual = 50  # SPEED of the settings' default, parameter 4 (§2.5, §5.6)
    # at a tenth of the speed it takes ten times as long as the deadline at full speed
    assert await bench.arm.grasp(30, 1.5, speed_share=0.1) == pytest.approx(38.9, abs=0.05)
    assert bench.wire.motor(1, 4).parameters[4] == usual // 10
    for share in (0.0, -0.1, 1.5):
        with pytest.raises(ValueError, match="above 0 to 1"):
            await bench.arm.grasp(30, speed_share=share)


async def test_a_grip_on_nothing_is_a_result() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    assert await bench.arm.grasp(force=30) == 0.0
    assert not bench.stops()


async def test_moving_with_a_held_part_is_no_stall_and_a_stall_is_still_seen() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).low = 600
    await bench.arm.grasp(force=30)  # leaves bit 3 in the general status of IP1 (§5.5)
    await bench.arm.move_counts({Axis.SHOULDER: 500, Axis.ZED: -300})
    assert bench.wire.motor(1, 1).counts == 500
    bench.wire.motor(1, 2).low = -700
    with pytest.raises(AxisStalledError, match="zed stalled"):
        await bench.arm.move_counts({Axis.ZED: -900})


async def test_a_grip_without_motor_power_is_noticed() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).powered = False
    with pytest.raises(AxisStalledError, match="gripper rests against nothing"):
        await bench.arm.grasp(force=30)


async def test_jaws_that_never_meet_anything_are_stopped() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    with pytest.raises(AxisStalledError, match=r"still closes after 0\.3 s"):
        await bench.arm.grasp(force=30, deadline_s=0.3)
    assert bench.stops() == {0, 1}


async def test_jaws_on_a_part_are_read_by_the_next_controller_before_homing() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).low = 600
    await bench.arm.grasp(force=30)
    await bench.arm.connect()  # as after a kill: no stop was sent
    assert not bench.arm.is_homed
    bench.forget()
    reading = await bench.arm.read_jaws()
    assert reading.is_pressing
    assert reading.opening_mm == pytest.approx(38.9, abs=0.05)
    assert set(bench.does()) <= {b"\x29"}  # asked with reads alone, but for the hand-over


async def test_jaws_that_press_on_nothing_say_so() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    assert not (await bench.arm.read_jaws()).is_pressing


async def test_jaws_are_widened_without_homing_and_nothing_else_moves() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).low = 600
    await bench.arm.grasp(force=30)
    await bench.arm.aclose()
    bench.wire.is_open = True
    await bench.arm.connect()
    with pytest.raises(PowerOffError):
        await bench.arm.drive_jaws(10.0)
    await bench.arm.enable_power()
    motors = {address: bench.wire.motor(*address) for address in ADDRESSES.values()}
    before = {address: motor.counts for address, motor in motors.items()}
    assert await bench.arm.drive_jaws(10.0) >= 10.0
    moved = {a: motor.counts - before[a] for a, motor in motors.items()}
    assert 10.0 / 0.0584 <= moved.pop((1, 4)) <= 10.0 / 0.0584 + 200  # §5.5: mm per count
    assert set(moved.values()) == {0}
    now = bench.wire.motor(1, 4).counts
    await bench.clock.sleep(2.0)
    bench.wire.advance()
    assert bench.wire.motor(1, 4).counts == now


async def test_jaws_pressed_once_more_stand_on_a_part_and_close_on_nothing() -> None:
    bench = await Bench().homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).low = 600
    await bench.arm.grasp(force=30)
    assert await bench.arm.drive_jaws(-3.0) < 0.1
    bench.wire.motor(1, 4).low = -30  # it was taken out
    assert await bench.arm.drive_jaws(-3.0) >= 3.0


async def test_a_width_in_millimetres_is_reached() -> None:
    bench = await Bench().homed()
    assert await bench.arm.move_gripper_mm(20.4) == pytest.approx(20.4, abs=0.05)
    assert await bench.arm.close_jaws() == 0.0
    bench.forget()
    with pytest.raises(OutOfRangeError, match=r"120\.0 mm of 0 to 85\.5 mm"):
        await bench.arm.move_gripper_mm(120.0)
    assert not bench.requests()


@pytest.mark.parametrize(
    ("counts", "mm"), [(0, 0.0), (300, 18.5), (600, 38.9), (900, 61.2), (1200, 85.5)]
)
def test_the_gripper_law_is_the_fit_of_the_reference(counts: int, mm: float) -> None:
    law = GripperLaw()
    assert law.opening_mm(counts) == pytest.approx(mm, abs=0.05)
    assert law.counts(law.opening_mm(counts)) == counts


def test_three_measured_widths_make_a_law() -> None:
    law = GripperLaw.through([(0, 1.0), (500, 34.0), (1100, 80.0)])
    assert law.opening_mm(0) == pytest.approx(1.0)
    assert law.opening_mm(500) == pytest.approx(34.0)
    assert law.opening_mm(1100) == pytest.approx(80.0)
    assert law.counts(34.0) == 500
    straight = GripperLaw.through([(0, 0.0), (500, 35.0), (1000, 70.0)])
    assert straight.counts(49.0) == 700
    with pytest.raises(ValueError, match="three points"):
        GripperLaw.through([(0, 0.0), (0, 1.0), (5, 2.0)])
    with pytest.raises(ValueError, match="steadily"):
        GripperLaw.through([(0, 0.0), (600, 60.0), (1200, 20.0)])


async def test_read_q_is_the_forward_side_of_move_joints() -> None:
    bench = await Bench().homed()
    q = np.array([0.3, -0.6, 0.2, -250.0, -0.9, 0.4])
    await bench.arm.move_joints(q)
    got = await bench.arm.read_q()
    # half a count of each motor (§5.1): 0.017 to 0.05 deg, and 0.13 mm of zed
    assert np.abs(got - q)[[0, 1, 2, 4, 5]].max() < np.deg2rad(0.08)
    assert abs(got[3] - q[3]) < 0.14


# ---- settings of one installation --------------------------------------------------------------
async def test_homing_and_jaws_push_as_the_cell_file_says() -> None:
    settings = UmiSettings(homing_zed_speed=25, homing_zed_force=22, jaw_speed=45)
    bench = Bench(config=settings.config(silence_s=0.5))
    await bench.homed()
    await bench.arm.open_jaws()
    bench.wire.motor(1, 4).low = 600
    await bench.arm.grasp(force=30)
    sent = list(pairwise(data for _, data in bench.wire.writes))
    # a deferred write names the parameter, then ctl and value (umi_rtx.md 2.5): zed is ctl 2
    assert (b"\x70\x04\x00", b"\x7a\x19\x00") in sent
    assert (b"\x70\x0a\x00", b"\x7a\x16\x00") in sent
    assert (b"\x70\x04\x00", b"\x7c\x2d\x00") in sent  # the gripper is ctl 4


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"jaw_force": 90}, "jaw_force: 1 to 60, not 90"),
        ({"homing_zed_speed": 0}, "homing_zed_speed: 1 to 100, not 0"),
        ({"homing_s": float("nan")}, "homing_s: 1 to 300, not nan"),
        ({"arrival_counts": -1}, "arrival_counts: 0 to 20, not -1"),
    ],
)
def test_settings_no_arm_has_been_run_with_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        UmiSettings(**given)


def test_the_commented_cell_file_shows_the_arms_settings_with_their_defaults() -> None:
    for name in ("emulated", "metrology"):
        text = (ROOT / f"recipes/cells/{name}.yaml").read_text(encoding="utf-8")
        (line,) = [one for one in text.splitlines() if one.startswith("  # arm: {address:")]
        shown = YAML(typ="safe").load(line.lstrip(" #"))["arm"]["settings"]
        assert shown == dataclasses.asdict(UmiSettings())
