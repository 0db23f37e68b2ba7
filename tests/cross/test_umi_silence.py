"""A silent line is detected after 0.5 s of cell time, wherever it happens."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from umi_bench import EMULATED
from umi_line_faults import PARK, Session, quiet

from controller.cell.batch.watching import ArmWatcher
from controller.cell.devices.in_use import counted
from controller.cell.machine import Event
from drivers.errors import SilentLineError
from drivers.umi_scara import Axis, MotionStoppedError

KNOWN_S = 0.5
STOPS_S = 0.05  # two stops and a hand-over, blindly, 9 ms apart
EXCHANGE_S = 0.05  # an exchange and a pause between polls
VERBS: dict[str, tuple[Callable[[Session], Awaitable[object]], int]] = {
    "idle": (lambda session: session.arm.read_counts(), 3),
    "move": (
        lambda session: session.arm.move_counts({Axis.SHOULDER: 2000, Axis.WRIST1: -2000}),
        120,
    ),
    "home": (lambda session: session.arm.home(), 400),
    "grip": (lambda session: session.arm.grasp(force=30), 100),
}


async def opened(silence_s: float = KNOWN_S) -> Session:
    session = Session(silence_s=silence_s)
    session.model.place({EMULATED[axis]: float(counts) for axis, counts in PARK.items()})
    await session._opened()
    session.model.reference()
    session.arm.positions.is_homed = True
    session.arm.positions.dead_bands = dict.fromkeys(Axis, 2)
    await session.arm.open_jaws()
    return session


@pytest.mark.parametrize("fault", ["mute", "unplugged"])
@pytest.mark.parametrize("verb", VERBS)
async def test_a_silent_arm_is_known_after_half_a_second_and_so_is_its_stop(
    verb: str, fault: str
) -> None:
    session = await opened()
    act, exchange_count = VERBS[verb]
    due_count = session.line.exchange_count + exchange_count
    pulled_s: list[float] = []

    def pull(_: bytes) -> None:
        if session.line.exchange_count >= due_count and not pulled_s:
            setattr(session.wire.faults, fault, True)
            pulled_s.append(session.clock.now_s())

    session.line.on_write = pull
    with quiet(), pytest.raises(SilentLineError) as failure:
        await act(session)
    known_s = session.clock.now_s() - pulled_s[0]
    assert KNOWN_S - 0.01 <= known_s <= KNOWN_S + STOPS_S + EXCHANGE_S
    for words in ("arm", "may go on", "emergency stop", "check power, cable, boards"):
        assert words in str(failure.value)
    began_s = session.clock.now_s()
    with quiet(), pytest.raises(SilentLineError):
        await session.arm.stop()
    assert session.clock.now_s() - began_s <= KNOWN_S
    if fault == "mute":  # the way to the arm is whole, and the stops were sent
        assert not session.running()


async def test_a_stop_in_mid_move_on_a_dead_line_does_not_wait_for_the_move() -> None:
    session = await opened()
    moving = asyncio.Event()

    def watch(_: bytes) -> None:
        if session.line.true(Axis.SHOULDER) > 20:
            moving.set()

    session.line.on_write = watch
    move = asyncio.create_task(session.arm.move_counts({Axis.SHOULDER: 2000}))
    await moving.wait()
    session.wire.faults.unplugged = True
    began_s = session.clock.now_s()
    with quiet(), pytest.raises(SilentLineError):
        await session.arm.stop()
    assert session.clock.now_s() - began_s <= 2 * KNOWN_S + STOPS_S  # the exchange in flight ends
    with pytest.raises((SilentLineError, MotionStoppedError)):
        await move


async def test_a_line_that_comes_back_is_in_step_again() -> None:
    session = await opened()
    session.wire.faults.unplugged = True
    with quiet(), pytest.raises(SilentLineError):
        await session.arm.read_counts()
    session.wire.faults.unplugged = False
    counts = await session.arm.read_counts()
    assert counts[Axis.SHOULDER] == pytest.approx(session.line.true(Axis.SHOULDER), abs=1)
    await session.arm.move_counts({Axis.SHOULDER: 100})
    assert session.line.true(Axis.SHOULDER) == pytest.approx(100, abs=4)


@pytest.mark.parametrize("fault", ["mute", "unplugged"])
async def test_a_line_that_falls_silent_at_rest_is_known_as_soon(fault: str) -> None:
    beat_s = 0.1
    session = await opened(silence_s=KNOWN_S - beat_s)
    device, in_use = counted(session.arm, session.clock)
    due_count = session.line.exchange_count + 20
    pulled_s: list[float] = []
    reported: list[tuple[str, float]] = []

    def pull(_: bytes) -> None:
        # between two heartbeats, as far as a line can tell: the next request is not answered
        if session.line.exchange_count >= due_count and not pulled_s:
            setattr(session.wire.faults, fault, True)
            pulled_s.append(session.clock.now_s() - beat_s)

    def report(event: Event, message: str = "", code: str = "") -> None:
        assert event is Event.FAULT
        reported.append((code, session.clock.now_s()))

    session.line.on_write = pull
    with quiet():
        await ArmWatcher(device, in_use, beat_s, session.clock).run(report)
    ((code, known_s),) = reported
    assert code == "silent_line"
    assert known_s - pulled_s[0] <= KNOWN_S + STOPS_S + EXCHANGE_S
