"""The conformance suite: sound devices pass it, and each requirement finds a broken driver."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AsyncExitStack
from types import SimpleNamespace
from typing import Any

import conformance_devices as d
import numpy as np
import pytest

from controller.conformance.families import FAMILIES
from controller.conformance.requirement import READS, NotMetError, NotTriedError, timed
from controller.conformance.suite import MET, NOT_MET, NOT_TRIED, RequirementResult, try_requirement
from drivers.clock import CellClock
from drivers.errors import BadReplyError, PositionLostError
from drivers.kinds import (
    Arm,
    Camera,
    FixedGripper,
    Hold,
    IoBlock,
    JawReading,
    LampUnit,
    Signal,
)
from simulation.loop import SimulatedLoop

KINDS: dict[str, Any] = {
    "arm": Arm,
    "camera": Camera,
    "gripper": FixedGripper,
    "io": IoBlock,
    "lights": LampUnit,
}
EVERY = [(kind, one.name) for kind, family in FAMILIES.items() for one in family]


@pytest.fixture(scope="module")
def loop() -> Iterator[SimulatedLoop]:
    """Return one loop for all: burying one collects garbage, which is slow among other tests."""
    loop = SimulatedLoop(1)
    yield loop
    loop.bury()
    loop.close()


def attempt(
    loop: SimulatedLoop,
    kind: str,
    name: str,
    make: type[d.Device],
    *,
    may_move: bool = True,
    may_act: bool = True,
) -> RequirementResult:
    """Try one requirement on a device in memory, in virtual time."""
    clock = CellClock(monotonic=loop.time)

    async def run() -> RequirementResult:
        bench = d.bench_of(kind, make, clock)
        bench.may_act = may_act
        (requirement,) = (one for one in FAMILIES[kind] if one.name == name)
        outcome = await try_requirement(bench, requirement, may_move=may_move)
        await bench.close()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)
        return outcome

    return loop.run_until_complete(run())


class HeldTime:
    """An emulated cell's clock in virtual time; what its readers miss is added by the test."""

    speed, window_s, waits = 4.0, 0.05, True

    def __init__(self, loop: SimulatedLoop) -> None:
        self.loop = loop
        self.missed_s = self.total_held_s = 0.0

    def now_s(self) -> float:
        return self.loop.time() * self.speed + self.missed_s

    def held_s(self) -> float:
        return self.total_held_s

    def hold(self) -> None:
        """Nobody looks for the last time here."""

    def release(self) -> None:
        """Nobody looks for the last time here."""


@pytest.mark.parametrize("is_shared", [False, True], ids=["wall clock", "shared clock"])
def test_a_device_is_charged_with_its_own_time_alone(loop: SimulatedLoop, is_shared: bool) -> None:
    time = HeldTime(loop)
    shared: Any = time if is_shared else None
    clock = CellClock(speed=time.speed, shared=shared, monotonic=lambda: time.now_s() / time.speed)

    async def took_s(extra: Callable[[], None], duration_s: float) -> float:
        async def doing() -> None:
            await clock.sleep(duration_s / 2)
            extra()
            await clock.sleep(duration_s / 2)

        bench = d.bench_of("lights", d.MemoryLights, clock)
        async with AsyncExitStack() as attending:
            if not is_shared:  # `taking_part` needs a real one, and measures nothing
                await attending.enter_async_context(clock.attending())
            await attending.enter_async_context(bench.stopwatch.attending())
            return await timed(bench, 1.0, doing(), "it")

    def nothing() -> None:
        pass

    def late() -> None:
        time.missed_s += 60.0  # in one go: the loop had no turn

    def held() -> None:
        time.missed_s += 60.0
        time.total_held_s += 60.0

    for extra in (nothing, late, held) if is_shared else (nothing, late):
        # exact to a beat and the jitter of a healthy loop, 25 ms of the wall
        within_s = 0.025 * time.speed
        assert loop.run_until_complete(took_s(extra, 0.9)) == pytest.approx(0.9, abs=within_s)
        with pytest.raises(NotMetError, match=r"it: took 1\.3"):
            loop.run_until_complete(took_s(extra, 1.35))


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_a_sound_device_meets_every_requirement(loop: SimulatedLoop, kind: str, name: str) -> None:
    outcome = attempt(loop, kind, name, d.SOUND[kind])
    assert (outcome.verdict, outcome.message) == (MET, "")


async def _nothing(*_: Any, **__: Any) -> None:
    return None


def _refuses_late(verb: str) -> dict[str, Any]:
    """Return a verb that sends something before it checks."""

    async def late(self: Any, *args: Any, **kwargs: Any) -> Any:
        self.line.sent_count += 8
        return await getattr(super(self.__class__, self), verb)(*args, **kwargs)

    return {verb: late}


async def _swallowed(self: d.Device) -> None:
    try:
        await d.Device.exchange(self)
    except asyncio.CancelledError:
        return


async def _hangs(self: d.Device) -> None:
    while self.line.is_silent:
        await self.clock.sleep(0.1)
    await d.Device.exchange(self)


async def _out_of_step(self: d.Device) -> None:
    """Owe the next caller the reply that a cancelled one did not wait for."""
    if getattr(self, "owes", False):
        raise BadReplyError("the reply to an earlier request")
    try:
        await d.Device.exchange(self)
    except asyncio.CancelledError:
        self.owes = True  # type: ignore[attr-defined]
        raise


async def _close_once(self: Any) -> None:
    if not self.is_open:
        raise RuntimeError("closed already")
    self.is_open = False


async def _never_again(self: Any) -> None:
    if getattr(self, "was_lost", False):
        raise BadReplyError("lost for good")
    if self.line.is_cut:
        self.was_lost = True
    await d.Device.exchange(self)


def _after(verb: str, extra: Callable[[Any], Awaitable[None]]) -> dict[str, Any]:
    """Return a verb that does something more when it is done."""

    async def more(self: Any, *args: Any, **kwargs: Any) -> Any:
        result = await getattr(super(self.__class__, self), verb)(*args, **kwargs)
        await extra(self)
        return result

    return {verb: more}


async def _moves_jaws(self: Any) -> None:
    self.body.send(self.body.opening_mm + 10.0)


async def _half_way(self: Any, opening_mm: float) -> None:
    self.check(opening_mm)
    await self.move(opening_mm / 2.0)


async def _claims_contact(self: Any, opening_mm: float, *, force_n: float) -> Any:
    await d.MemoryGripper.close_on(self, opening_mm, force_n=force_n)
    return SimpleNamespace(object_detected=True, opening_mm=self.body.opening_mm)


async def _in_inches(self: Any) -> Any:
    reading = await d.MemoryGripper.status(self)
    reading.opening_mm *= 25.4
    return reading


async def _runs_on(self: Any, target: Any) -> None:
    """Move without a stop on the way out."""
    await self.exchange()
    self.body.send(target)
    while self.body.is_moving:
        await self.exchange()


async def _joints_run_on(self: Any, q: Any, *, speed_share: float = 1.0) -> None:
    self.check(q, speed_share)
    self.require_homed()
    await self.exchange()
    self.body.send(q)
    while not np.allclose(self.body.q, self.body.target_q):
        await self.exchange()


async def _from_the_future(self: Any, levels: Any, *, settle: bool = False) -> float:
    return await d.MemoryLights.set(self, levels, settle=settle) - 10.0


async def _does_not_settle(self: Any, levels: Any, *, settle: bool = False) -> float:
    before_s = self.clock.now_s()
    await d.MemoryLights.set(self, levels)
    return float(before_s if settle else self.clock.now_s())


async def _slow(self: Any) -> float:
    await self.clock.sleep(2.0)
    return float(self.clock.now_s())


async def _takes_any_levels(self: Any, levels: Any, *, settle: bool = False) -> float:
    known = {name: level for name, level in levels.items() if name in self.names}
    clipped = {name: float(np.clip(np.nan_to_num(at), 0, 1)) for name, at in known.items()}
    return await d.MemoryLights.set(self, clipped, settle=settle)


async def _polls_late(self: Any) -> None:
    await self.clock.sleep(5.0)
    await d.MemoryIo.poll(self)


async def _gives_up(self: Any) -> None:
    while True:
        if self.line.is_cut:
            self.publish(Signal.UNKNOWN)
            return
        await self.exchange()
        self.publish(Signal.OK)
        await self.clock.sleep(0.04)


async def _keeps_what_it_knew(self: Any) -> None:
    await self.exchange()
    self.publish(Signal.OK)


async def _watch_goes_on(self: Any) -> None:
    self.watches.clear()
    await d.MemoryIo.aclose(self)


async def _resets_inputs(self: Any) -> None:
    await self.exchange()
    await self.aclose()
    await self.connect()
    self.poller.cancel()
    self.publish(Signal.NOT_OK)
    self.poller = asyncio.create_task(self.clock.sleep(100.0))


async def _remembers(self: Any) -> None:
    kept = dict(self.signals)
    await d.MemoryIo.aclose(self)
    self.signals = kept


async def _waits_for_ever(self: Any, name: str, signal: Signal) -> None:
    del signal
    self.signal(name)
    while True:
        try:
            await self.clock.sleep(100.0)
        except asyncio.CancelledError:
            return


async def _early(self: Any, t_s: float, timeout_s: float | None = None) -> Any:
    """Return the frame that is exposed at the instant, not the one after it."""
    del timeout_s
    await self.clock.sleep(t_s - self.clock.now_s())
    return SimpleNamespace(image=self.picture(), white=self.white)


async def _frames_while_paused(self: Any, t_s: float, timeout_s: float | None = None) -> Any:
    was_paused, self.is_paused = self.is_paused, False
    try:
        return await d.MemoryCamera.frame_after(self, t_s, timeout_s)
    finally:
        self.is_paused = was_paused


async def _no_patience(self: Any, t_s: float, timeout_s: float | None = None) -> Any:
    del timeout_s
    return await d.MemoryCamera.frame_after(self, t_s)


async def _deaf_to_unplugging(self: Any, t_s: float, timeout_s: float | None = None) -> Any:
    if self.line.is_cut:
        await self.clock.sleep(1e3)
    return await d.MemoryCamera.frame_after(self, t_s, timeout_s)


async def _frame_lost_for_good(self: Any, t_s: float, timeout_s: float | None = None) -> Any:
    if getattr(self, "owes", False):
        raise BadReplyError("the thread is gone")
    try:
        return await d.MemoryCamera.frame_after(self, t_s, timeout_s)
    except asyncio.CancelledError:
        self.owes = True
        raise


async def _close_camera_once(self: Any) -> None:
    await _close_once(self)


async def _degrees(self: Any) -> Any:
    return np.degrees(await d.MemoryArm.read_q(self))


async def _has_q_anyway(self: Any) -> Any:
    await self.exchange()
    return self.body.q


async def _moves_unhomed(self: Any, q: Any, *, speed_share: float = 1.0) -> None:
    self.is_homed = True
    await d.MemoryArm.move_joints(self, q, speed_share=speed_share)


async def _clips(self: Any, q: Any, *, speed_share: float = 1.0) -> None:
    if q.shape != (6,) or not np.isfinite(q).all():
        raise ValueError("joints")
    await d.MemoryArm.move_joints(self, np.clip(q, -d.RANGE, d.RANGE), speed_share=speed_share)


async def _stops_slowly(self: Any, *_: Any) -> None:
    await self.clock.sleep(1.5)
    await super(self.__class__, self).stop(*_)


async def _jaws_in_cm(self: Any, opening_mm: float) -> float:
    return await d.MemoryArm.move_gripper_mm(self, opening_mm) / 10.0


async def _mute_arm(self: Any) -> JawReading:
    if self.line.is_silent:
        await self.clock.sleep(1.2)
    return await d.MemoryArm.read_jaws(self)


async def _rude_stop(self: Any, *args: Any) -> None:
    """Stop, and let the move return as if it had arrived."""
    del args
    self.body.send(self.body.q)
    await self.exchange()


async def _open_to_returns(self: Any, opening_mm: float) -> None:
    self.check(opening_mm)
    await self.move(opening_mm)


BROKEN: list[tuple[str, str, dict[str, Any]]] = [
    *((kind, "identity", {"model": ""}) for kind in FAMILIES),
    *((kind, "time-out", {"exchange": _hangs}) for kind in ("gripper", "lights", "arm")),
    *((kind, "reconnect", {"exchange": _never_again}) for kind in ("gripper", "lights", "arm")),
    *((kind, "cancellation", {"exchange": _out_of_step}) for kind in ("gripper", "lights", "arm")),
    *((kind, "cancellation", {"exchange": _swallowed}) for kind in ("gripper", "lights", "arm")),
    *((kind, "close", {"aclose": _close_once}) for kind in ("gripper", "arm")),
    ("gripper", "reading", {"status": _in_inches}),
    ("gripper", "reading", {"hold": _nothing}),
    ("gripper", "still", _after("connect", _moves_jaws)),
    ("gripper", "limits", {"check": lambda self, opening_mm, force_n=1.0: None}),
    ("gripper", "limits", _refuses_late("open_to")),
    ("gripper", "units", {"open_to": _half_way}),
    ("gripper", "empty", {"close_on": _claims_contact}),
    ("gripper", "empty", {"hold": lambda self: asyncio.sleep(0, Hold.HELD)}),
    ("gripper", "stop", {"stop": _nothing}),
    ("gripper", "stop", {"stop": _stops_slowly}),
    ("gripper", "stop", {"open_to": _open_to_returns}),
    ("gripper", "cancelled", {"move": _runs_on}),
    ("lights", "names", {"names": ("ring",)}),
    ("lights", "limits", {"set": _takes_any_levels}),
    ("lights", "limits", _refuses_late("set")),
    ("lights", "since", {"set": _from_the_future}),
    ("lights", "settle", {"set": _does_not_settle}),
    ("lights", "dark", {"all_off": _slow}),
    ("io", "inputs", {"poll": _polls_late}),
    ("io", "limits", {"signal": lambda self, name: self.signals.get(name, Signal.UNKNOWN)}),
    ("io", "time-out", {"poll": _keeps_what_it_knew}),
    ("io", "reconnect", {"poll": _gives_up}),
    ("io", "changes", {"aclose": _watch_goes_on}),
    ("io", "watchdog", {"clear_watchdog": _resets_inputs}),
    ("io", "cancellation", {"wait_for": _waits_for_ever}),
    ("io", "close", {"aclose": _remembers}),
    ("camera", "picture", {"picture": lambda self: np.zeros((48, 32), np.uint8)}),
    ("camera", "picture", {"white": 50}),
    ("camera", "after", {"frame_after": _early}),
    ("camera", "pause", {"frame_after": _frames_while_paused}),
    ("camera", "time-out", {"frame_after": _no_patience}),
    ("camera", "reconnect", {"frame_after": _deaf_to_unplugging}),
    ("camera", "cancellation", {"frame_after": _frame_lost_for_good}),
    ("camera", "close", {"close": _close_camera_once}),
    ("arm", "reading", {"read_jaws": lambda self: asyncio.sleep(0, JawReading(None, 0.0))}),  # type: ignore[arg-type]
    ("arm", "not homed", {"read_q": _has_q_anyway}),
    ("arm", "not homed", {"move_joints": _moves_unhomed}),
    ("arm", "time-out", {"read_jaws": _mute_arm}),
    ("arm", "limits", {"move_joints": _clips}),
    ("arm", "limits", {"grasp": _nothing}),
    ("arm", "limits", {"move_gripper_mm": lambda self, mm: asyncio.sleep(0, mm)}),
    ("arm", "units", {"read_q": _degrees}),
    ("arm", "jaws", {"move_gripper_mm": _jaws_in_cm}),
    ("arm", "stop", {"stop": _stops_slowly}),
    ("arm", "stop", {"stop": _nothing}),
    ("arm", "stop", {"stop": _rude_stop}),
    ("arm", "cancelled", {"move_joints": _joints_run_on}),
]


@pytest.mark.parametrize(
    ("kind", "name", "instead"),
    BROKEN,
    ids=[f"{kind}-{name}-{'-'.join(instead)}" for kind, name, instead in BROKEN],
)
def test_a_driver_that_is_broken_is_found(
    loop: SimulatedLoop, kind: str, name: str, instead: dict[str, Any]
) -> None:
    broken = type("Broken", (d.SOUND[kind],), instead)
    outcome = attempt(loop, kind, name, broken)
    assert outcome.verdict == NOT_MET
    assert outcome.message


def test_every_requirement_has_a_driver_that_does_not_meet_it() -> None:
    assert {(kind, name) for kind, name, _ in BROKEN} == set(EVERY)


@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, one.name) for kind, family in FAMILIES.items() for one in family if one.moves],
)
def test_nothing_moves_unless_it_is_allowed(loop: SimulatedLoop, kind: str, name: str) -> None:
    class Untouchable(d.Device):
        async def connect(self) -> None:
            raise PositionLostError("it was touched")

    outcome = attempt(loop, kind, name, Untouchable, may_move=False)
    assert outcome.verdict == NOT_TRIED
    assert "--allow-motion" in outcome.message


def test_what_moves_metal_is_marked_so() -> None:
    moving = {(kind, one.name) for kind, family in FAMILIES.items() for one in family if one.moves}
    assert moving == {
        *(("gripper", name) for name in ("units", "empty", "stop", "cancelled")),
        *(("arm", name) for name in ("limits", "units", "jaws", "stop", "cancelled")),
    }


@pytest.mark.parametrize(("kind", "name"), EVERY)
def test_without_consent_no_requirement_calls_a_verb(
    loop: SimulatedLoop, kind: str, name: str
) -> None:
    called: list[str] = []

    def noted(verb: str) -> Any:
        async def note(*_: object, **__: object) -> None:
            called.append(verb)

        return note

    sound = d.SOUND[kind]
    verbs = [
        verb
        for verb in dir(KINDS[kind])  # a fake has helpers beside them
        if verb[0] != "_"
        and verb not in READS
        and inspect.iscoroutinefunction(getattr(sound, verb, None))
    ]
    assert verbs or kind == "camera"
    watched: Any = type("Watched", (sound,), {verb: noted(verb) for verb in verbs})
    (requirement,) = (one for one in FAMILIES[kind] if one.name == name)
    outcome = attempt(loop, kind, name, watched, may_move=False, may_act=False)
    assert called == []
    commands = requirement.moves or requirement.acts
    assert outcome.verdict == (NOT_TRIED if commands else MET)


def test_a_verb_that_a_requirement_calls_all_the_same_is_not_sent(loop: SimulatedLoop) -> None:
    async def run() -> None:
        bench = d.bench_of("gripper", d.SOUND["gripper"], CellClock(monotonic=loop.time))
        bench.may_act = False
        device = await bench.opened()
        assert (await device.status()).opening_mm >= 0.0
        with pytest.raises(NotTriedError, match="`open_to` commands the device"):
            await device.open_to(10.0)
        bench.may_act = True
        await device.activate()
        await bench.close()

    loop.run_until_complete(run())
