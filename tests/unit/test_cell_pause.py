"""Pauses, resumes and permits: what moves, what waits, and what nobody has permitted."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions import SuspendAction, UnsuspendAction
from controller.cell.batch import BatchEnd, Dispatcher
from controller.cell.custody import Custody
from controller.cell.devices.interlocks import BUILT_IN_RULES, Truth, Violation
from controller.cell.errors import InterlockError, NoPermitError, PartFaultError
from controller.cell.journal import Journal, read_rows
from controller.cell.journal.rows import FirstMotion
from controller.cell.machine import Effect, Event, PartFault, PauseKind, SafePoint
from controller.cell.operator import Answer, Desk, Journaled
from controller.cell.services import Approval, Gate, Motion, Permits, Standstill
from controller.cell.services.gate import JAWS_S, STOP_RAMP_S, Mover
from controller.cell.services.motion import homing_preview
from controller.cell.services.records import BatchRecord, RunProgress
from controller.config import load_cell
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from drivers.errors import MotionStoppedError, PositionLostError
from drivers.kinds import Signal, Stop

ROOT = Path(__file__).parents[2]
LAYOUT = build_layout(load_cell(ROOT / "recipes/cells/emulated.yaml"))
ANY: Any = SimpleNamespace
(DOOR,) = (rule for rule in BUILT_IN_RULES if rule.code == "guard_closed")


def at(number: int) -> np.ndarray:
    return LAYOUT.park_q + np.array([number / 100, 0, 0, 0, 0, 0])


class Arm:
    """Moves when it is let, and stops half-way when it is stopped."""

    def __init__(self) -> None:
        self.q = at(0)
        self.orders: list[int] = []
        self.stops: list[Stop] = []
        self.is_homed = True
        self.homing_count = 0
        self.arrive = asyncio.Event()
        self._stop = asyncio.Event()

    async def enable_power(self) -> None: ...

    async def home(self) -> None:
        self.homing_count += 1
        await self._go(self.q)
        self.is_homed = True

    async def move_joints(self, q: np.ndarray) -> None:
        self.orders.append(round((q - LAYOUT.park_q)[0] * 100))
        await self._go(q)

    async def _go(self, q: np.ndarray) -> None:
        self._stop.clear()
        waits = [asyncio.ensure_future(e.wait()) for e in (self.arrive, self._stop)]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for wait in waits:
                wait.cancel()
        if self._stop.is_set():
            self.q = (self.q + q) / 2
            raise MotionStoppedError("arm: the motion was stopped on request")
        self.arrive.clear()
        self.q = q

    async def stop(self, kind: Stop) -> None:
        self.stops.append(kind)
        self._stop.set()

    async def read_q(self) -> np.ndarray:
        if not self.is_homed:
            raise PositionLostError("arm: not homed")
        return self.q


async def settle() -> None:
    """Let every task run until it waits."""
    for _ in range(20):
        await asyncio.sleep(0)


class Bench:
    """Machine, dispatcher, gate and arm, with work as a test writes it."""

    def __init__(self, folder: Path) -> None:
        clock = CellClock(1000.0)
        self.path = folder / "journal.sqlite"
        self.journal = Journal(self.path, "run")
        self.arm = Arm()
        self.signal = Signal.OK
        io: Any = ANY(signal=lambda name: self.signal)
        self.gate = Gate(Permits(self.journal), clock, self.approval())
        self.gate.reach(SafePoint.PARKED, ends_step=True)

        async def admit(path: object) -> None: ...

        interlocks: Any = ANY(admit_path=admit, holding=self._open_door)
        self.motion = Motion(self.arm, interlocks, clock, self.gate, LAYOUT)  # type: ignore[arg-type]
        self.record = BatchRecord(self.journal, RunProgress(), lambda: None)
        self.checks: list[str] = []
        self.stopped: list[tuple[str, ...]] = []
        self.is_held = True
        stopping: Any = ANY(
            stop_arm=self.arm.stop, halt_arm=lambda: self.arm.stop(Stop.DEAD), stop_others=settle,
            stop_moving=self._stop_moving,
        )  # fmt: skip
        self.jaws_mm = (40.0, 85.0)
        grippers: Any = ANY(require_held=self._require_held, openings_mm=self._openings_mm)
        self.standstill = Standstill(self.gate, self.motion, grippers, self.record, LAYOUT)
        self.suspend = SuspendAction(self.gate, stopping, self.standstill)
        self.unsuspend = UnsuspendAction(self.gate, io, grippers, self.record, self.standstill)
        self.works: dict[Effect, Callable[[], Awaitable[Event]]] = {
            Effect.HOME: self._end(Event.RESET_DONE),
            Effect.ACQUIRE: self._end(Event.PICTURE_TAKEN),
            Effect.RECOGNISE: self._end(Event.PART_RECOGNISED),
            Effect.PLAN: self._end(Event.PLANNED),
            Effect.STOP_MOTION: self._end(Event.STOP_DONE),
            Effect.ABORT_MOTION: self._end(Event.ABORT_DONE),
            Effect.SUSPEND: self.suspend.run,
            Effect.UNSUSPEND: self.unsuspend.run,
        }
        actions: Any = ANY(perform=lambda effect: self.works[effect]())
        self.dispatcher = Dispatcher(
            actions, self.record, stopping, (), self.journal, self.gate, interlocks,
            self.standstill,
        )  # fmt: skip
        self.running: asyncio.Task[BatchEnd] | None = None

    def approval(self) -> Approval | None:
        """Return who lets each motion begin."""
        return None

    def _end(self, event: Event) -> Callable[[], Awaitable[Event]]:
        async def run() -> Event:
            return event

        return run

    async def _require_held(self) -> None:
        self.gate.permits.require()
        self.checks.append("held?")
        if not self.is_held:
            raise PartFaultError(PartFault.DROPPED, "gone")

    async def _openings_mm(self) -> tuple[float, float]:
        return self.jaws_mm

    async def _stop_moving(self, *, is_arm: bool, is_fixed: bool) -> None:
        self.stopped.append(("arm",) * is_arm + ("fixed",) * is_fixed)
        if is_arm:
            await self.arm.stop(Stop.DEAD)

    def _open_door(self) -> Violation | None:
        return None if self.signal is Signal.OK else Violation(DOOR, Truth.FALSE, ())

    async def open_door(self) -> None:
        """The door opens, and the watcher says so."""
        self.signal = Signal.NOT_OK
        message = Violation(DOOR, Truth.FALSE, ()).message
        self.dispatcher._report(Event.GUARD_OPENED, message, DOOR.code)
        await settle()

    async def start(self, grasp: Callable[[], Awaitable[Event]]) -> None:
        self.works[Effect.GRASP] = grasp
        self.running = asyncio.create_task(self.dispatcher.run())
        await settle()

    async def send(self, event: Event) -> str:
        decision = await self.dispatcher.command(event, "uid 1000", "to look")
        await settle()
        return decision.answer

    async def arrive(self) -> None:
        self.arm.arrive.set()
        await settle()

    async def end(self) -> BatchEnd:
        assert self.running is not None
        self.dispatcher.request_stop()
        outcome = await self.running
        self.journal.close()
        return outcome

    @property
    def names(self) -> list[str]:
        return [row.name for row in read_rows(self.path)]


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    made = Bench(tmp_path)
    yield made
    if made.running is not None and not made.running.done():
        await made.end()
    made.journal.close()


async def walk(bench: Bench) -> Event:
    """Three waypoints, a safe point after the first, a step's end after the second."""
    bench.gate.begin_step(60.0)
    await bench.motion.follow((at(1),))
    bench.motion.reach(SafePoint.ABOVE_TABLE)
    await bench.motion.follow((at(2),))
    bench.motion.reach(SafePoint.LIFTED, ends_step=True)
    bench.gate.begin_step(60.0)
    await bench.motion.follow((at(3), at(4)))
    await asyncio.Event().wait()
    return Event.GRASPED


async def test_now_stops_the_arm_on_its_ramp_and_resume_goes_to_the_same_waypoint(
    bench: Bench,
) -> None:
    await bench.start(lambda: walk(bench))
    assert bench.arm.orders == [1]
    assert await bench.send(Event.PAUSE_NOW) == "handled"
    assert bench.arm.stops == [Stop.RAMP]
    assert bench.dispatcher.state == "suspended_grasping"
    await bench.arrive()  # nothing is on its way any more
    bench.arm.arrive.clear()
    assert bench.arm.orders == [1]
    assert await bench.send(Event.RESUME) == "handled"
    assert bench.dispatcher.state == "execute_grasping"
    assert bench.checks == ["held?"]
    assert bench.arm.orders == [1, 1]


@pytest.mark.parametrize(
    ("kind", "last"),
    [(Event.PAUSE_AT_SAFE_POINT, 1), (Event.PAUSE_AFTER_STEP, 2), (Event.STEP, 2)],
)
async def test_a_pause_begins_at_the_point_that_its_kind_waits_for(
    bench: Bench, kind: Event, last: int
) -> None:
    await bench.start(lambda: walk(bench))
    await bench.send(kind)
    for number in range(1, last + 1):
        assert bench.dispatcher.state == "suspending_grasping"
        assert bench.arm.orders[-1] == number
        await bench.arrive()
    assert bench.dispatcher.state == "suspended_grasping"
    assert bench.arm.orders == list(range(1, last + 1))
    assert bench.arm.stops == []
    await bench.send(Event.RESUME)
    assert bench.arm.orders[-1] == last + 1


async def test_a_step_ends_where_the_next_one_begins(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_AT_SAFE_POINT)
    await bench.arrive()
    assert bench.dispatcher.state == "suspended_grasping"
    await bench.send(Event.STEP)
    assert bench.arm.orders == [1, 2]
    assert bench.dispatcher.state == "suspending_grasping"
    await bench.arrive()
    assert bench.dispatcher.state == "suspended_grasping"
    assert bench.arm.orders == [1, 2]
    assert await bench.send(Event.STEP) == "handled"
    assert bench.arm.orders == [1, 2, 3]


async def test_a_pause_may_become_more_urgent_and_never_less(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_AT_SAFE_POINT)
    await bench.send(Event.PAUSE_AFTER_STEP)
    assert bench.gate.wanted is PauseKind.SAFE_POINT
    await bench.send(Event.PAUSE_NOW)
    assert bench.dispatcher.state == "suspended_grasping"
    assert bench.arm.stops == [Stop.RAMP]


async def test_jaws_finish_what_they_have_begun_before_a_pause_begins(bench: Bench) -> None:
    closed = asyncio.Event()

    async def preview() -> FirstMotion:
        return FirstMotion(words="jaws close")

    async def close() -> Event:
        async with bench.gate.moving(preview, Mover.ARM_JAWS):
            await closed.wait()
        return Event.GRASPED

    async def show() -> Event:
        await bench.motion.follow((at(5),))
        return Event.SHOWN

    bench.works[Effect.PRESENT] = show
    await bench.start(close)
    assert bench.gate.seconds_to(PauseKind.NOW) == JAWS_S
    await bench.send(Event.PAUSE_NOW)
    assert bench.dispatcher.state == "suspending_grasping"
    closed.set()
    await settle()
    # the grasp ended while the cell came to its pause: what follows waits
    assert bench.dispatcher.state == "suspended_presenting"
    assert bench.arm.orders == []
    first = await bench.gate.next_motion()
    assert first is not None
    assert (first.origin[0], first.goal[0]) == pytest.approx((at(0)[0], at(5)[0]), abs=1e-4)
    await bench.send(Event.RESUME)
    assert bench.arm.orders == [5]


async def test_what_moves_first_is_known_and_written_before_it_moves(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.arrive()
    await bench.send(Event.PAUSE_NOW)
    first = await bench.gate.next_motion()
    assert first is not None
    assert first.seconds > 0
    assert first.tcp_mm > 0
    await bench.send(Event.RESUME)
    rows = {row.name: row for row in read_rows(bench.path)}
    assert rows["first_motion"].body["goal"] == [round(float(v), 4) for v in at(2)]
    names = bench.names
    resumed = [row.name for row in read_rows(bench.path) if row.body.get("who")]
    assert resumed == ["pause_now", "resume"]
    assert names.index("resume") < names.index("first_motion") < names.index("resumed")


async def test_what_moves_first_shows_as_soon_as_it_is_known(bench: Bench) -> None:
    computed = asyncio.Event()

    async def plan() -> Event:
        await computed.wait()
        return Event.PLANNED

    bench.works[Effect.PLAN] = plan
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_NOW)
    status = await bench.dispatcher.status()
    assert (status.state, status.first) == ("suspended_planning", None)
    computed.set()
    await settle()
    status = await bench.dispatcher.status()
    assert status.state == "suspended_grasping"
    assert status.first is not None
    assert status.first.goal == tuple(round(float(v), 4) for v in at(1))
    assert bench.arm.orders == []


async def test_an_open_door_before_a_resume_moves_nothing_and_ends_nothing(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_NOW)
    await bench.open_door()
    assert bench.dispatcher.state == "suspended_grasping"
    assert (await bench.dispatcher.status()).barred == "guard_closed: the door is open; close it"
    assert await bench.send(Event.RESUME) == "refused"
    assert bench.arm.orders == [1]
    assert bench.checks == []
    # a person paused, so that the door needs no acknowledgement
    bench.signal = Signal.OK
    bench.record.part.custody = Custody.IN_ARM
    assert await bench.send(Event.RESUME) == "handled"
    assert bench.arm.orders == [1, 1]


# ---- an open door ------------------------------------------------------------------------------
async def test_an_open_door_stops_the_arm_at_once_and_holds_the_run(bench: Bench) -> None:
    bench.record.part.custody = Custody.IN_ARM
    await bench.start(lambda: walk(bench))
    await bench.open_door()
    assert bench.stopped == [("arm",)]
    status = await bench.dispatcher.status()
    assert (status.state, status.alarm) == ("suspended_grasping", "202 the door is open")
    assert status.message == "guard_closed: the door is open; close it"
    assert bench.arm.orders == [1]
    bench.signal = Signal.OK
    assert await bench.send(Event.RESUME) == "refused"
    assert await bench.send(Event.ACKNOWLEDGE) == "handled"
    assert (await bench.dispatcher.status()).barred == ""
    assert bench.arm.orders == [1]
    assert await bench.send(Event.RESUME) == "handled"
    assert bench.dispatcher.state == "execute_grasping"
    assert bench.checks == ["held?"]
    assert bench.arm.orders == [1, 1]
    (row,) = [row for row in read_rows(bench.path) if row.name == "acknowledged"]
    assert (row.body["code"], row.body["who"], row.body["why"]) == (
        "guard_closed", "uid 1000", "to look",
    )  # fmt: skip


async def test_an_open_door_cannot_be_acknowledged(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.open_door()
    assert await bench.send(Event.ACKNOWLEDGE) == "refused"
    bench.signal = Signal.OK
    assert await bench.send(Event.ACKNOWLEDGE) == "handled"
    assert await bench.send(Event.ACKNOWLEDGE) == "refused"  # once is enough


async def test_the_acknowledge_button_counts_as_a_persons_word(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.open_door()
    bench.signal = Signal.OK
    bench.dispatcher._report(Event.ACKNOWLEDGE)
    await settle()
    (row,) = [row for row in read_rows(bench.path) if row.name == "acknowledged"]
    assert row.body["who"] == "the acknowledge button"


async def test_what_comes_to_the_gate_while_the_door_is_open_waits_there(bench: Bench) -> None:
    """The watcher may be later than the next motion: the gate reads the door itself."""
    bench.record.part.custody = Custody.IN_ARM
    await bench.start(lambda: walk(bench))
    bench.signal = Signal.NOT_OK
    await bench.arrive()
    assert bench.arm.orders == [1]
    assert bench.dispatcher.state == "suspended_grasping"


async def test_a_part_that_no_gripper_has_is_looked_for_after_an_open_door(bench: Bench) -> None:
    async def withdraw() -> Event:
        await bench.motion.follow((at(9),))
        return Event.WITHDRAWN

    bench.works[Effect.WITHDRAW] = withdraw
    await bench.start(lambda: walk(bench))
    await bench.open_door()
    bench.signal = Signal.OK
    await bench.send(Event.ACKNOWLEDGE)
    first = (await bench.dispatcher.status()).first
    assert first is not None
    assert "parks" in first.words
    assert await bench.send(Event.STEP) == "refused"
    await bench.send(Event.RESUME)
    assert bench.dispatcher.state == "execute_withdrawing"
    assert bench.arm.orders == [1, 9]


@pytest.mark.parametrize("what", ["arm", "jaws"])
async def test_what_was_moved_by_hand_behind_an_open_door_does_not_go_on(
    bench: Bench, what: str
) -> None:
    bench.record.part.custody = Custody.IN_ARM
    await bench.start(lambda: walk(bench))
    await bench.open_door()
    bench.signal = Signal.OK
    left_q, left_mm = bench.arm.q, bench.jaws_mm
    if what == "arm":
        bench.arm.q = at(40)
    else:
        bench.jaws_mm = (44.0, 85.0)
    await bench.send(Event.ACKNOWLEDGE)
    await bench.send(Event.RESUME)
    status = await bench.dispatcher.status()
    assert status.state == "suspended_grasping"
    assert "put that back and resume" in status.message
    assert bench.arm.orders == [1]
    bench.arm.q, bench.jaws_mm = left_q, left_mm
    await bench.send(Event.RESUME)
    assert bench.dispatcher.state == "execute_grasping"
    assert bench.arm.orders == [1, 1]


async def test_homing_that_an_open_door_stops_begins_anew_after_the_resume(bench: Bench) -> None:
    async def home() -> Event:
        await bench.motion.home()
        return Event.RESET_DONE

    bench.arm.is_homed = False
    bench.works[Effect.HOME] = home
    await bench.start(lambda: walk(bench))
    assert bench.dispatcher.state == "resetting"
    await bench.open_door()
    status = await bench.dispatcher.status()
    assert (status.state, status.alarm) == ("suspended_resetting", "202 the door is open")
    assert bench.stopped == [("arm",)]
    bench.signal = Signal.OK
    assert await bench.send(Event.RESUME) == "refused"
    assert await bench.send(Event.ACKNOWLEDGE) == "handled"
    first = (await bench.dispatcher.status()).first
    assert first is not None
    assert first.words.startswith("the arm homes")
    assert bench.arm.homing_count == 1
    assert await bench.send(Event.RESUME) == "handled"
    assert (bench.dispatcher.state, bench.arm.homing_count) == ("resetting", 2)
    await bench.arrive()
    assert bench.dispatcher.state == "execute_grasping"
    assert bench.arm.orders == [1]


async def test_a_door_that_opens_as_homing_ends_holds_what_follows(bench: Bench) -> None:
    homed = asyncio.Event()

    async def home() -> Event:
        await homed.wait()
        return Event.RESET_DONE

    bench.works[Effect.HOME] = home
    await bench.start(lambda: walk(bench))
    homed.set()
    await bench.open_door()
    assert bench.dispatcher.state == "suspended_resetting"
    bench.signal = Signal.OK
    await bench.send(Event.ACKNOWLEDGE)
    assert bench.dispatcher.state == "suspended_resetting"
    await bench.send(Event.RESUME)
    assert bench.dispatcher.state == "execute_grasping"


async def test_a_cell_that_is_started_with_its_door_open_waits_for_it(bench: Bench) -> None:
    async def admit() -> None:
        if (violation := bench._open_door()) is not None:
            raise InterlockError(violation.message, violation.code, holds=violation.rule.holds)

    async def home() -> Event:
        await bench.gate.until_admitted(admit, homing_preview)
        return Event.RESET_DONE

    bench.signal = Signal.NOT_OK
    bench.works[Effect.HOME] = home
    await bench.start(lambda: walk(bench))
    assert bench.dispatcher.state == "suspended_resetting"
    bench.signal = Signal.OK
    await bench.send(Event.ACKNOWLEDGE)
    await bench.send(Event.RESUME)
    assert bench.dispatcher.state == "execute_grasping"


async def test_a_door_that_opens_during_a_resume_stops_it(bench: Bench) -> None:
    bench.record.part.custody = Custody.IN_ARM
    pressed = asyncio.Event()

    async def press() -> None:
        await pressed.wait()

    await bench.start(lambda: walk(bench))
    await bench.open_door()
    bench.signal = Signal.OK
    await bench.send(Event.ACKNOWLEDGE)
    bench.unsuspend.grippers.require_held = press  # type: ignore[method-assign]
    await bench.send(Event.RESUME)
    assert bench.dispatcher.state == "unsuspending_grasping"
    await bench.open_door()
    assert bench.dispatcher.state == "suspended_grasping"
    bench.signal = Signal.OK
    assert await bench.send(Event.RESUME) == "refused"
    assert bench.arm.orders == [1]


async def test_a_part_that_is_gone_after_a_pause_is_looked_for_and_not_carried_on(
    bench: Bench,
) -> None:
    withdrawn = asyncio.Event()

    async def perform(effect: Effect) -> Event:
        try:
            return await bench.works[effect]()
        except PartFaultError:
            return Event.PART_DROPPED

    async def withdraw() -> Event:
        await bench.motion.follow((at(9),))
        withdrawn.set()
        return Event.WITHDRAWN

    bench.dispatcher._actions = ANY(perform=perform)
    bench.works[Effect.WITHDRAW] = withdraw
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_NOW)
    bench.is_held = False
    await bench.send(Event.RESUME)
    assert bench.dispatcher.state == "suspended_withdrawing"
    assert bench.arm.orders == [1]
    bench.is_held = True
    await bench.send(Event.RESUME)
    assert bench.arm.orders == [1, 9]


async def test_a_stop_takes_the_permit_away_and_only_a_start_gives_a_new_one(
    bench: Bench,
) -> None:
    moved_on: list[str] = []

    async def stubborn() -> Event:
        """Work that goes on after its end: only the permit keeps it from moving."""
        try:
            await bench.motion.follow((at(1),))
        finally:
            try:
                await bench.motion.follow((at(2),))
            except NoPermitError as error:
                moved_on.append(str(error))
        return Event.GRASPED

    await bench.start(stubborn)
    assert bench.gate.permits.permit is not None
    outcome = await bench.end()
    assert outcome.end == "stopped"
    assert bench.arm.orders == [1]
    assert moved_on == [
        "nothing may move: no permit since `stop`; start or resume the cell to permit motion"
    ]
    issued = [(r.name, r.body["by"]) for r in read_rows(bench.path) if r.name.startswith("permit")]
    assert issued == [
        ("permit_issued", "reset"), ("permit_issued", "start"), ("permit_withdrawn", "stop"),
    ]  # fmt: skip


async def test_nothing_has_a_permit_before_a_start_and_during_a_pause(bench: Bench) -> None:
    with pytest.raises(NoPermitError, match="nobody has started the cell"):
        await bench.motion.follow((at(1),))
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_NOW)
    assert bench.gate.permits.permit is None
    with pytest.raises(NoPermitError), bench.gate.checking():
        await bench.motion.follow((at(7),))
    assert bench.arm.orders == [1]


async def test_a_stop_during_a_pause_ends_the_run_and_moves_nothing(bench: Bench) -> None:
    await bench.start(lambda: walk(bench))
    await bench.send(Event.PAUSE_NOW)
    outcome = await bench.end()
    assert outcome.end == "stopped"
    assert bench.arm.orders == [1]


async def test_commands_before_the_start_and_after_the_end_are_refused(bench: Bench) -> None:
    early = await bench.dispatcher.command(Event.PAUSE_NOW, "me")
    assert (early.answer, early.reason) == (
        "refused", "the run is still connecting its devices",
    )  # fmt: skip
    await bench.start(lambda: walk(bench))
    await bench.end()
    late = await bench.dispatcher.command(Event.RESUME, "me")
    assert (late.answer, late.reason) == ("refused", "the run has come to rest")


async def test_the_seconds_shown_are_those_of_what_moves(bench: Bench) -> None:
    gate = bench.gate
    assert [gate.seconds_to(kind) for kind in PauseKind] == [0.0, 0.0, 0.0]  # parked
    await bench.start(lambda: walk(bench))
    step = gate.seconds_to(PauseKind.AFTER_STEP)
    assert step is not None
    assert 50.0 < step <= 60.0
    assert gate.seconds_to(PauseKind.NOW) == STOP_RAMP_S


async def test_a_pause_that_is_over_lets_a_check_through_and_nothing_else(bench: Bench) -> None:
    bench.gate.permits.issue("resume")
    bench.gate.close()
    blocked = asyncio.create_task(bench.motion.follow((at(1),)))
    await settle()
    assert not blocked.done()
    assert bench.arm.orders == []
    blocked.cancel()
    await asyncio.gather(blocked, return_exceptions=True)


async def test_interlocks_are_checked_before_the_hold(bench: Bench) -> None:
    bench.signal = Signal.UNKNOWN
    with pytest.raises(InterlockError):
        await bench.unsuspend.run()
    assert bench.checks == []
    assert bench.record.part.custody is Custody.ON_TABLE


# ---- motion by motion (`cellctl run --step`) ---------------------------------------------------
class Stepwise(Bench):
    """A cell whose every motion a person at a desk lets begin."""

    def approval(self) -> Approval | None:
        self.desk = Desk(is_attended=True)
        return Approval(Journaled(self.desk, self.journal))

    async def go(self) -> str:
        refusal = self.desk.answer(None, Answer("go", "uid 1000"))
        await settle()
        return refusal


@pytest.fixture
async def stepwise(tmp_path: Path) -> AsyncIterator[Stepwise]:
    made = Stepwise(tmp_path)
    yield made
    if made.running is not None and not made.running.done():
        await made.end()
    made.journal.close()


async def test_each_motion_is_shown_and_begins_with_a_persons_answer(stepwise: Stepwise) -> None:
    await stepwise.start(lambda: walk(stepwise))
    for number in (1, 2, 3, 4):
        raised = stepwise.desk.open
        assert raised is not None
        assert raised.number == number
        expected = await stepwise.motion._preview(at(number))
        assert raised.question.text == f"next: {expected.words}"
        assert stepwise.arm.orders == list(range(1, number))
        assert await stepwise.go() == ""
        assert stepwise.arm.orders == list(range(1, number + 1))
        assert stepwise.desk.open is None
        await stepwise.arrive()
    assert stepwise.names.count("question_answered") == 4


async def test_a_pause_while_a_motion_is_shown_has_it_shown_anew(stepwise: Stepwise) -> None:
    await stepwise.start(lambda: walk(stepwise))
    assert await stepwise.send(Event.PAUSE_NOW) == "handled"
    assert stepwise.dispatcher.state == "suspended_grasping"
    await stepwise.go()
    assert stepwise.arm.orders == []  # a pause holds what has been let begin
    assert await stepwise.send(Event.RESUME) == "handled"
    assert stepwise.arm.orders == []
    raised = stepwise.desk.open
    assert raised is not None
    assert raised.number == 2
    await stepwise.go()
    assert stepwise.arm.orders == [1]


async def test_a_stop_ends_a_motion_that_nobody_has_let_begin(stepwise: Stepwise) -> None:
    await stepwise.start(lambda: walk(stepwise))
    outcome = await stepwise.end()
    assert outcome.end == "stopped"
    assert stepwise.arm.orders == []
    assert stepwise.desk.open is None
    assert await stepwise.go() == "there is no question to answer"


async def test_nothing_moves_stepwise_where_nobody_is_there(stepwise: Stepwise) -> None:
    stepwise.desk.leave()
    await stepwise.start(lambda: walk(stepwise))
    assert stepwise.arm.orders == []
    assert stepwise.running is not None
    outcome = await stepwise.running
    assert "nobody is there to permit each motion" in outcome.message
