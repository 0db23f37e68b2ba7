"""Jogging the simulated cell: what moves, what is refused, and that every stop halts the arm."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stories import play

from controller.bring_up.jogging import ArmReading, JogOrders, JogSession, TakenOver
from controller.bring_up.procedure import StepEnd, StepRecord
from controller.cell.devices.clocks import FoundClock
from controller.cell.operator import Answer, Question
from controller.config import load_cell
from emulators.umi_scara import COUNTS_PER_DEG, Axis
from simulation.cell import BEAT_S, SimulatedCell
from simulation.loop import SimulatedLoop, SimulatedProcess

HOMED = ("home", "open arm 40", "park", "z -100")


class Script:
    """A pilot who gives orders from a list; something may befall the cell a while after one."""

    is_live = False

    def __init__(
        self, orders: tuple[str, ...], after: str = "", then: Callable[[], None] = lambda: None
    ) -> None:
        self.ends_at_refusal = False
        self.left = list(orders)
        self.given: list[str] = []
        self.after, self.then = after, then
        self.readings: list[ArmReading] = []
        self.words: list[str] = []
        self.refusals: dict[str, str] = {}
        self.questions: list[str] = []
        self.declines = ""
        self.stop = asyncio.Event()

    async def order(self) -> str | None:
        if not self.left:
            return None
        self.given.append(self.left.pop(0))
        if self.given[-1] == self.after:
            # well within the motion that follows, by the cell's own clock
            asyncio.get_running_loop().call_later(3.0, self.then)
        return self.given[-1]

    async def wants_stop(self) -> None:
        await self.stop.wait()
        self.stop.clear()

    async def decide(self, question: Question) -> Answer | None:
        self.questions.append(question.text)
        declines = bool(self.declines) and self.declines in question.text
        return Answer(question.choices[-1 if declines else 0].key, "a tester")

    def show(self, reading: ArmReading) -> None:
        self.readings.append(reading)

    def done(self, order: str, words: str) -> None:
        self.words.append(words)

    def refused(self, order: str, why: str) -> None:
        self.refusals[order] = why


class Story:
    """A simulated cell and jogs in it."""

    def __init__(self, loop: SimulatedLoop, cell: SimulatedCell, out: Path) -> None:
        self.loop, self.cell, self.out = loop, cell, out
        out.mkdir()

    def session(
        self, pilot: Script, accept: Callable[[TakenOver], str] | None = None
    ) -> JogSession:
        return JogSession(
            JogOrders(
                cell=load_cell(self.cell.cell_path),
                emulated={},
                clock=FoundClock(monotonic=self.loop.time, beat_wall_s=BEAT_S),
                folder=self.out,
                by="a tester",
            ),
            pilot,
            accept,
            self.cell.controller()._devices,
        )

    async def run(self, session: JogSession) -> StepRecord:
        record: StepRecord = await self.loop.spawn(SimulatedProcess("jog"), session.run())
        return record

    def counts(self) -> dict[Axis, float]:
        return {axis: motor.position for axis, motor in self.cell.cell.arm.axes.items()}

    def require_at_rest(self) -> None:
        before = self.counts()
        self.cell.catch_up()
        assert self.counts() == before


Play = Callable[[Callable[[Story], Awaitable[Any]]], None]


@pytest.fixture(name="play")
def play_here(tmp_path: Path) -> Play:
    """Return what runs a story on a loop of its own."""
    return partial(play, tmp_path, Story)


def test_before_homing_only_motors_and_homing_are_allowed(play: Play) -> None:
    async def story(one: Story) -> None:
        before = one.counts()
        pilot = Script(("joint 1 5", "x +", "park", "open arm", "take", "motor nose"))
        record = await one.run(one.session(pilot))
        assert record.outcome is StepEnd.PASSED
        assert set(pilot.refusals) == {
            "joint 1 5", "x +", "park", "open arm", "take", "motor nose",
        }  # fmt: skip
        assert all("not homed" in pilot.refusals[o] for o in ("joint 1 5", "x +", "park"))
        assert "elbow" in pilot.refusals["motor nose"]
        assert one.counts() == before
        assert pilot.readings[0].q is None
        assert set(pilot.readings[0].counts) == {axis.name.lower() for axis in Axis}

    play(story)


def test_orders_move_the_arm_by_what_they_name_and_steps_add_up(play: Play) -> None:
    async def story(one: Story) -> None:
        pilot = Script((*HOMED, "joint 1 -25", "joint 2 -50", "step 1", *["x +"] * 6, "joint 4 7"))
        assert (await one.run(one.session(pilot))).outcome is StepEnd.PASSED
        assert not pilot.refusals
        # a reading stands before each order, and one after the last
        joints = [np.array(reading.joints) for reading in pilot.readings[-10:]]
        # whole counts, and the dead band of two of them, in degrees of the shoulder
        assert joints[0][:3] == pytest.approx([55.0, 0.0, 0.0], abs=0.3)
        assert joints[1][:3] == pytest.approx([55.0, -50.0, 0.0], abs=0.3)
        first, last = pilot.readings[-8].T_world_tcp, pilot.readings[-2].T_world_tcp
        assert first is not None
        assert last is not None
        # six steps of 1 mm: as near as single counts bring the TCP (umi_rtx.md 6.6), not six times
        assert last[:3, 3] - first[:3, 3] == pytest.approx([6.0, 0.0, 0.0], abs=1.5)
        assert joints[-1][3] - joints[-2][3] == pytest.approx(7.0, abs=0.6)

    play(story)


@pytest.mark.slow
def test_what_may_not_be_is_refused_with_its_reason_and_nothing_moves(play: Play) -> None:
    async def story(one: Story) -> None:
        refused = ("joint 9 +", "x 60", "lamp sun on", "open arm 500", "take", "dance")
        pilot = Script((*HOMED, *refused))
        assert (await one.run(one.session(pilot))).outcome is StepEnd.PASSED
        assert set(pilot.refusals) == set(refused)
        assert len(pilot.readings) == len(HOMED) + len(refused) + 1
        assert "end of its reach" in pilot.refusals["x 60"]
        assert "no lamp" in pilot.refusals["lamp sun on"]
        assert "no order" in pilot.refusals["dance"]

    play(story)


def test_a_stop_by_the_pilot_halts_and_the_jog_goes_on(play: Play) -> None:
    async def story(one: Story) -> None:
        pilot = Script((*HOMED, "joint 1 -40", "show", "joint 1 -5"), after="joint 1 -40")
        pilot.then = pilot.stop.set
        assert (await one.run(one.session(pilot))).outcome is StepEnd.PASSED
        assert "halted" in pilot.refusals["joint 1 -40"]
        before, after, _, last = [np.array(r.joints) for r in pilot.readings[-4:]]
        assert 1.0 < before[0] - after[0] < 39.0  # on its way, and not at its end
        assert after[0] - last[0] == pytest.approx(5.0, abs=0.3)

    play(story)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "what", ["door", pytest.param("Ctrl-C", marks=SLOW), pytest.param("estop", marks=SLOW)]
)
def test_whatever_ends_a_jog_halts_the_arm_above_tray(play: Play, what: str) -> None:
    async def story(one: Story) -> None:
        pilot = Script((*HOMED, "joint 1 -40", "joint 1 -5"), after="joint 1 -40")
        session = one.session(pilot)
        pilot.then = {
            "Ctrl-C": lambda: session.request_stop("the terminal is gone", "terminal_gone"),
            "door": lambda: one.cell.befall("door", closed=False),
            "estop": lambda: one.cell.befall("estop", pressed=True),
        }[what]
        before = None

        def remember() -> None:
            nonlocal before
            before = one.counts()[Axis.SHOULDER]

        then, pilot.then = pilot.then, lambda: (remember(), then())[-1]
        record = await one.run(session)
        assert record.outcome is StepEnd.BROKEN_OFF
        assert {"Ctrl-C": "terminal", "door": "door", "estop": "emergency stop"}[what] in (
            record.message
        )
        assert "joint 1 by -5 deg" not in pilot.words
        one.require_at_rest()
        goal = 40.0 * 14.6  # counts of the shoulder a degree (umi_rtx.md 5.1), rounded
        assert before is not None
        assert abs(one.counts()[Axis.SHOULDER] - before) < goal / 2

    play(story)


def test_who_does_not_agree_to_motion_gets_none(play: Play) -> None:
    async def story(one: Story) -> None:
        before = one.counts()
        pilot = Script(("home",))
        pilot.declines = "slowly"
        record = await one.run(one.session(pilot))
        assert record.outcome is StepEnd.BROKEN_OFF
        assert not pilot.given
        assert one.counts() == before

    play(story)


@pytest.mark.slow
def test_what_presses_is_opened_only_after_a_word(play: Play) -> None:
    async def story(one: Story) -> None:
        pilot = Script((*HOMED, "close arm", "open arm"))
        pilot.declines = "will fall"
        assert (await one.run(one.session(pilot))).outcome is StepEnd.PASSED
        assert "will fall" in pilot.refusals["open arm"]
        assert pilot.readings[-1].arm_opening_mm == pytest.approx(0.0, abs=1.0)

    play(story)


# umi_rtx.md 4.2 and 5.2: what homing labels, and where the stops truly are [counts]
FOLDED = [
    (92.0, 0.0),
    pytest.param(104.0, -40.0, marks=SLOW),
    pytest.param(110.0, 0.0, marks=SLOW),
    pytest.param(116.0, -58.0, marks=SLOW),
    (-116.0, 58.0),
    pytest.param(150.0, -80.0, marks=SLOW),
]


@pytest.mark.parametrize(("elbow_deg", "shoulder_deg"), FOLDED)
def test_homing_from_a_folded_elbow_finds_the_shoulders_stop_and_not_the_column(
    play: Play, elbow_deg: float, shoulder_deg: float
) -> None:
    async def story(one: Story) -> None:
        arm = one.cell.cell.arm
        counts = {
            Axis.ELBOW: elbow_deg * COUNTS_PER_DEG[Axis.ELBOW],
            Axis.SHOULDER: shoulder_deg * COUNTS_PER_DEG[Axis.SHOULDER],
            Axis.YAW: elbow_deg / 2 * COUNTS_PER_DEG[Axis.YAW],
            Axis.ZED: -1500.0,
        }
        arm.place(counts)
        pilot = Script(("home",))
        assert (await one.run(one.session(pilot))).outcome is StepEnd.PASSED
        assert not pilot.refusals
        # at the park every counter but zed's reads 0 (umi_rtx.md 4.1, step 7)
        for axis in (Axis.SHOULDER, Axis.ELBOW, Axis.YAW, Axis.WRIST1, Axis.WRIST2):
            assert one.counts()[axis] == pytest.approx(0.0, abs=3.0), axis

    play(story)
