"""One wrong byte in a whole session: no axis moves without an order, and no false success.

benchmarks/bench_wire_faults.py goes through every place; here are those that used to go wrong, and
a few drawn by a seed.
"""

import asyncio
import random
from contextlib import suppress

import pytest
from umi_bench import EMULATED
from umi_line_faults import (
    LineFault,
    Noise,
    Session,
    SessionName,
    Way,
    faults_at,
    quiet,
    run_session,
)

from drivers.errors import DeviceError, PositionLostError
from drivers.umi_scara import Axis, LineUncertainError, MotionStoppedError


@pytest.mark.parametrize("name", ["moves", "homing"])
def test_a_session_without_a_fault_moves_what_is_asked_and_nothing_else(name: SessionName) -> None:
    result = run_session(name)
    assert result.end == "clean"
    assert not result.is_bad
    assert result.largest_counts < 2
    assert not result.errors


@pytest.mark.parametrize("seed", range(4))
def test_one_wrong_byte_moves_no_other_axis_and_makes_nothing_false(seed: int) -> None:
    rng = random.Random(seed)
    with quiet():
        for name in ("moves", "homing"):
            clean = run_session(name)
            for _ in range(6):
                way = rng.choice(("to the arm", "from the arm"))
                place = rng.randrange(clean.place_counts[way])
                fault = rng.choice(faults_at(way, place, [rng.randrange(8)]))
                result = run_session(name, fault)
                assert not result.is_bad, (fault, result)


class OneBurst(Noise):
    """Noise of given bytes in the gap before one byte of ours."""

    def __init__(self, line: "Session", at: int, data: bytes) -> None:
        super().__init__(0, 0.0)
        self._session, self._at, self._data = line, at, data

    def burst(self, now_s: float) -> tuple[Way, list[tuple[float, bytes]]] | None:
        if self.burst_count or self._session.line.counts["to the arm"] < self._at:
            return None
        self.burst_count = 1
        return "to the arm", [(now_s + 0.001, self._data)]


@pytest.mark.parametrize(
    ("name", "data", "share"),
    [("moves", "24", 0.3), ("moves", "17", 0.7), ("homing", "38", 0.5), ("homing", "24", 0.8)],
)
def test_a_session_goes_on_after_noise_that_the_arm_has_answered(
    name: SessionName, data: str, share: float
) -> None:
    """Questions and stops that nobody sent: whatever verb is at work is begun again."""
    with quiet():
        place = int(share * run_session(name).place_counts["to the arm"])
        session = Session()
        session.line.noise = OneBurst(session, place, bytes.fromhex(data))
        result = asyncio.run(session.run(name))
    assert result.end == "recovered", result.errors
    assert not result.is_bad, result


def test_nothing_moves_again_after_a_stop_that_came_while_the_line_was_uncertain() -> None:
    session = Session()
    arm, tried = session.arm, []

    async def move() -> None:
        tried.append(True)
        await arm.stop()
        raise LineUncertainError("noise")

    async def story() -> None:
        await arm.connect()
        with pytest.raises(MotionStoppedError):
            await arm._session.until_certain(move)

    with quiet():
        asyncio.run(story())
    assert len(tried) == 1


def test_the_judge_sees_an_axis_that_nobody_asked() -> None:
    """An axis moved behind the driver's back is reported; else the tests above mean nothing."""
    session = Session()
    hear = session.line.on_write
    assert hear is not None

    def sabotage(data: bytes) -> None:
        hear(data)
        if data == b"\xa3":  # the first move's go
            zed = session.model.axes[EMULATED[Axis.ZED]]
            zed.position += 20
            zed.rest(zed.drive)

    session.line.on_write = sabotage
    with quiet():
        result = asyncio.run(session.run("moves"))
    assert result.moved["zed"] >= 20
    assert result.is_bad


def test_a_register_that_was_hit_instead_of_the_one_meant_does_no_harm() -> None:
    """The lowest bit of requests from the first move to the grip: another motor, parameter, go."""
    with quiet():
        for place in range(60, 140, 3):
            result = run_session("moves", LineFault("to the arm", place, "flipped", bit=0))
            assert not result.is_bad, (place, result)


def test_after_a_stop_whose_hand_over_became_define_home_no_position_is_believed() -> None:
    """`29` and `21` differ by one bit; a board that took `21` reads zero wherever its axes are."""
    session = Session()
    arm, line = session.arm, session.line

    async def story() -> None:
        await arm.connect()
        await arm.enable_power()
        session.is_homing = True
        await arm.home()
        session.is_homing = False
        line.allow({Axis.SHOULDER, Axis.WRIST1, Axis.WRIST2})
        await arm.move_counts({Axis.SHOULDER: 500, Axis.WRIST1: -300, Axis.WRIST2: -300})
        line.fault = LineFault("to the arm", line.counts["to the arm"] + 1, "flipped", bit=3)
        with suppress(DeviceError):
            await arm.stop()
        assert line.has_struck
        line.allow({Axis.SHOULDER, Axis.WRIST1, Axis.WRIST2})
        with pytest.raises(PositionLostError):
            await arm.move_counts({Axis.SHOULDER: 400, Axis.WRIST1: -200, Axis.WRIST2: -200})

    with quiet():
        asyncio.run(story())
    assert line.true(Axis.SHOULDER) == pytest.approx(500, abs=6)
