"""The arm's driver against an emulated line that is strict about the 8 ms of umi_rtx.md 1.2.

No terminal and no real time: the emulator's wire is the driver's transport, on a clock that jumps,
since a busy host cannot keep milliseconds. What does not need them is tried on a real terminal.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import sys
from pathlib import Path

import pytest

from drivers.umi_scara import Axis, UmiScara, WireExchange, kinematics
from emulators.umi_scara import ArmModel, ArmWire

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
        self.arm = UmiScara(lambda: self.line, clock=self.clock, trace=self.trace.append)

    async def homed(self) -> "Bench":
        await self.arm.connect()
        await self.arm.enable_power()
        await self.arm.home()
        return self

    def true_counts(self) -> list[int]:
        joints = self.line.model.joints()
        q = [joints.shoulder_rad, joints.elbow_rad, joints.yaw_rad]
        q += [joints.zed_mm, joints.pitch_rad, joints.roll_rad]
        return kinematics.q_to_counts(q).tolist()


async def test_no_request_comes_too_early_from_opening_to_the_end_of_a_move() -> None:
    bench = await Bench(listening=1).homed()
    assert bench.true_counts() == pytest.approx([0, 0, -18, 0, 0, 0], abs=4)
    target = [-1200, 1700, -900, -900, -600, -400]
    await bench.arm.move_joints(kinematics.counts_to_q(target))
    assert bench.true_counts() == pytest.approx(target, abs=4)
    assert len(bench.trace) > 500
    assert not [x for x in bench.trace if x.reply == b"\x0c"]  # §2.9: too early


@pytest.mark.parametrize("axis", [Axis.SHOULDER, Axis.ZED, Axis.YAW])
async def test_a_reading_that_a_motion_overtakes_is_one_of_an_arm_in_motion(axis: Axis) -> None:
    bench = await Bench(listening=1).homed()
    moving = asyncio.ensure_future(bench.arm.move_counts({axis: -900}))
    # asked for before the motion has the arm: at 28 requests to some 10, it goes on in mid-motion
    assert len(await bench.arm.read_counts()) == len(Axis)
    assert (await moving)[axis] == pytest.approx(-900, abs=2)
