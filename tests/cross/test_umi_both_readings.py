"""The arm's driver against the arm's emulator: two readings of umi_rtx.md that must agree.

No terminal and no real time: the emulator's wire is the driver's transport, on a clock that jumps.
The wire is strict about the 8 ms of 1.2.
"""

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import LinkError, PositionLostError, WrongDeviceError
from drivers.umi_scara import Axis, AxisStalledError, UmiScara, WireExchange, kinematics
from emulators.umi_scara import ArmModel, ArmWire
from emulators.umi_scara import Axis as EmulatedAxis

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from umi_fakes import FakeClock

STEP_S = 0.002


class EmulatedTransport:
    """The emulator's wire as the driver's transport."""

    def __init__(self, clock: FakeClock, *, listening: int = 0) -> None:
        self._clock = clock
        self.model = ArmModel(seed=3)
        self.wire = ArmWire(self.model, strict=True, listening=listening)
        self._reached_s = clock.now_s()

    def _advance(self) -> None:
        now_s = self._clock.now_s()
        while self._reached_s < now_s - 1e-9:
            dt_s = min(STEP_S, now_s - self._reached_s)
            self.model.advance(dt_s)
            self._reached_s += dt_s

    def write(self, data: bytes) -> None:
        self._advance()
        self.wire.feed(data, self._clock.now_s())

    async def read(self, timeout_wall_s: float) -> bytes:
        await asyncio.sleep(0)
        until_s = self._clock.now_s() + timeout_wall_s
        while True:
            self._advance()
            if out := self.wire.due(self._clock.now_s()):
                return out
            left_s = until_s - self._clock.now_s()
            if left_s <= 0:
                return b""
            self._clock.advance(max(min(left_s, 0.0005), 1e-6))

    async def aclose(self) -> None:
        pass


class Bench:
    def __init__(self, *, listening: int = 0) -> None:
        self.clock = FakeClock()
        self.line = EmulatedTransport(self.clock, listening=listening)
        self.trace: list[WireExchange] = []
        self.polled = asyncio.Event()
        self.arm = UmiScara(lambda: self.line, clock=self.clock, trace=self._hear)

    def _hear(self, exchange: WireExchange) -> None:
        self.trace.append(exchange)
        if exchange.request in (b"\x11", b"\x12", b"\x17"):
            self.polled.set()

    async def homed(self) -> "Bench":
        await self.arm.connect()
        await self.arm.enable_power()
        await self.arm.home()
        self.trace.clear()
        self.polled.clear()
        return self

    def true_counts(self) -> list[int]:
        joints = self.line.model.joints()
        q = [joints.shoulder_rad, joints.elbow_rad, joints.yaw_rad]
        q += [joints.zed_mm, joints.pitch_rad, joints.roll_rad]
        return kinematics.q_to_counts(q).tolist()


async def test_homing_finds_out_where_the_arm_truly_is() -> None:
    bench = await Bench(listening=1).homed()
    assert bench.true_counts() == pytest.approx([0, 0, -18, 0, 0, 0], abs=4)
    assert not any(exchange.reply == b"\x0c" for exchange in bench.trace)


async def test_joints_are_reached_all_axes_together() -> None:
    bench = await Bench().homed()
    rng = np.random.default_rng(5)
    for _ in range(5):
        counts = [rng.integers(-2000, 2000), rng.integers(-2500, 2500), rng.integers(-3000, -100)]
        target = [*counts, -900, -600, int(counts[0]) // 3]
        await bench.arm.move_joints(kinematics.counts_to_q(target))
        assert bench.true_counts() == pytest.approx(target, abs=4)


FAULTS: dict[str, Callable[[ArmWire], None]] = {
    "first byte lost": lambda wire: setattr(wire.faults, "drop_reply_byte", 0),
    "last byte lost": lambda wire: setattr(wire.faults, "drop_reply_byte", 2),
    "corrupt read": lambda wire: setattr(wire.faults, "corrupt_next_read", True),
    "corrupt write": lambda wire: setattr(wire.faults, "corrupt_next_write", True),
    "late replies": lambda wire: setattr(wire.faults, "reply_delay_s", 0.05),
}


@pytest.mark.parametrize("fault", FAULTS)
async def test_a_move_comes_through_a_fault_of_the_line(fault: str) -> None:
    bench = await Bench().homed()
    FAULTS[fault](bench.line.wire)
    await bench.arm.move_counts({Axis.SHOULDER: 500, Axis.WRIST1: -300, Axis.WRIST2: -400})
    assert bench.true_counts() == pytest.approx([0, 500, -18, -300, -400, 0], abs=4)


@pytest.mark.parametrize("ip", [0, 1])
async def test_a_restart_in_mid_move_stops_everything(ip: int) -> None:
    bench = await Bench().homed()
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: 2500, Axis.WRIST1: -2500}))
    await bench.polled.wait()
    bench.line.wire.restart(ip)
    with pytest.raises(PositionLostError):
        await move
    assert not bench.arm.is_homed
    rests_at = bench.true_counts()
    bench.clock.advance(2.0)
    await bench.line.read(0)
    assert bench.true_counts() == pytest.approx(rests_at, abs=60)  # servo lag of the stop, no more


async def test_a_jammed_axis_is_named() -> None:
    bench = await Bench().homed()
    bench.line.model.jam(EmulatedAxis.SHOULDER)
    with pytest.raises(AxisStalledError, match="shoulder"):
        await bench.arm.move_counts({Axis.SHOULDER: 1500})


async def test_a_dead_board_and_a_strange_rom_are_told_apart() -> None:
    dead = Bench()
    dead.line.wire.kill(1)
    with pytest.raises(LinkError, match="check power, cable, boards"):
        await dead.arm.connect()
    strange = Bench()
    strange.line.wire.faults.monitor_rom = True
    with pytest.raises(WrongDeviceError, match="unsupported ROM"):
        await strange.arm.connect()


async def test_automatic_toggling_of_a_crashed_predecessor_does_no_harm() -> None:
    bench = Bench()
    bench.line.wire.run_warm(auto_toggle=True)
    identity = await bench.arm.connect()
    assert not identity.was_restarted
    await bench.arm.enable_power()
    await bench.arm.home()
    assert bench.true_counts() == pytest.approx([0, 0, -18, 0, 0, 0], abs=4)
