"""Commissioning in the simulated cell: a step passes, is stopped, loses a device, and goes on."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest
from stories import play

from controller.bring_up import CommissioningSession, CommissionOrder, due
from controller.bring_up.person import HELPER
from controller.bring_up.procedure import CommissioningFolder, StepEnd, StepRecord, StepStatus
from controller.cell.devices.clocks import FoundClock
from controller.cell.operator import NOBODY, Answer, Operator, Question
from controller.config import ConfigError
from emulators.umi_scara import Axis
from simulation.cell import BEAT_S, SimulatedCell
from simulation.loop import SimulatedLoop, SimulatedProcess


class Helper:
    """Answers for a person; something befalls the cell when a question is put."""

    def __init__(self, code: str = "", then: Callable[[], None] = lambda: None) -> None:
        self.code, self.then = code, then
        self.texts: list[str] = []

    async def decide(self, question: Question) -> Answer:
        self.texts.append(question.text)
        if self.code and self.code in question.text:
            self.code = ""
            self.then()
        return Answer(question.choices[0].key, HELPER)


class Story:
    """A simulated cell and sessions of commissioning on it."""

    def __init__(self, loop: SimulatedLoop, cell: SimulatedCell, out: Path) -> None:
        self.loop, self.cell = loop, cell
        self.order = CommissionOrder(cell.cell_path, CommissioningFolder(out), "a tester")
        self.lines: list[str] = []
        self.number = 0

    def session(self, operator: Operator) -> CommissioningSession:
        controller = self.cell.controller()
        return CommissioningSession(
            self.order,
            {},
            FoundClock(monotonic=self.loop.time, beat_wall_s=BEAT_S),
            operator,
            None,
            self.lines.append,
            controller._devices,
        )

    async def run(self, session: CommissioningSession) -> StepRecord:
        """Run the step `devices` to its end, as a controller of its own."""
        self.number += 1
        process = SimulatedProcess(f"session {self.number}")
        (record,) = await self.loop.spawn(process, session.run(("devices",), lambda record: None))
        return record

    def status(self) -> StepStatus:
        return self.order.standings(datetime.now(UTC))[0].status

    def counts(self) -> dict[Axis, float]:
        return {axis: motor.position for axis, motor in self.cell.cell.arm.axes.items()}


def test_a_step_that_passes_leaves_its_record_and_is_done(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        helper = Helper()
        record = await one.run(one.session(helper))
        assert (record.outcome, record.message) == (StepEnd.PASSED, "")
        assert one.status() is StepStatus.DONE
        assert due(one.order.standings(datetime.now(UTC)), None) == (
            "light",
            "arm",
            "grippers",
            "trays",
            "reach",
            "verify",
        )
        # each motor and each axis of homing had a question of its own (umi_rtx.md 10), and the
        # shoulder, which is homed once more, two
        assert sum("motor" in text and "moves next" in text for text in helper.texts) == 7
        assert sum(text.startswith("Homing:") for text in helper.texts) == 7
        assert {told.who for told in record.answers} == {HELPER}
        assert record.by == "a tester"

    play(tmp_path, Story, story)


def test_a_stop_half_way_halts_the_arm_and_the_next_start_goes_on(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        session = one.session(NOBODY)
        helper = Helper("shoulder", lambda: session.request_stop("Ctrl-C", "stop"))
        session._operator = helper
        record = await one.run(session)
        assert record.outcome is StepEnd.BROKEN_OFF
        assert "Ctrl-C" in record.message
        before = one.counts()
        one.cell.catch_up()
        assert one.counts() == before
        assert one.status() is StepStatus.NOT_DONE
        assert (await one.run(one.session(Helper()))).outcome is StepEnd.PASSED
        assert one.status() is StepStatus.DONE

    play(tmp_path, Story, story)


def test_an_emergency_stop_half_way_is_latched_until_somebody_has_seen_it(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        helper = Helper("Homing: the shoulder", lambda: one.cell.befall("estop", pressed=True))
        record = await one.run(one.session(helper))
        assert record.outcome is StepEnd.BROKEN_OFF
        one.cell.befall("estop", pressed=False)
        one.cell.befall("reset")
        again = Helper()
        assert (await one.run(one.session(again))).outcome is StepEnd.PASSED
        assert any("acknowledged" in text for text in again.texts)

    play(tmp_path, Story, story)


WATCHDOG_S = 1.0


def test_the_watchdog_is_proven_by_cutting_communication(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        helper = Helper()
        record = await one.run(one.session(helper))
        assert (record.outcome, record.message) == (StepEnd.PASSED, "")
        assert any("lose their supply next" in text for text in helper.texts)
        (went,) = [figure for figure in record.figures if "without supply" in figure.name]
        assert went.value == pytest.approx(WATCHDOG_S, abs=0.1)  # as its web console has it
        assert any("restored it" in text for text in record.findings)
        offs = [change for change in one.cell.cell.supply_changes if not change.on]
        assert len(offs) >= 2  # proven as it connects, and again by the step

    play(tmp_path, Story, story, watchdog_s=WATCHDOG_S)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"off": True}, "has not tripped within"),
        ({"bridged": True}, "still have their supply"),
    ],
)
def test_a_watchdog_that_stops_nothing_fails_the_step(
    tmp_path: Path, wrong: dict[str, bool], told: str
) -> None:
    async def story(one: Story) -> None:
        one.cell.befall("io_watchdog", **wrong)
        record = await one.run(one.session(Helper()))
        assert record.outcome is StepEnd.FAILED
        assert told in record.message

    play(tmp_path, Story, story, watchdog_s=WATCHDOG_S)


def test_a_cell_without_a_watchdog_is_told_what_a_frozen_computer_does(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        record = await one.run(one.session(Helper()))
        assert any("freezes, the arm is not stopped" in text for text in record.findings)

    play(tmp_path, Story, story)


@pytest.mark.parametrize(
    ("device", "word"),
    [
        ("arm", "arm"),
        pytest.param("gripper", "gripper", marks=pytest.mark.slow),
        pytest.param("io", "supply|estop|I/O|link", marks=pytest.mark.slow),
    ],
)
def test_a_device_that_is_lost_half_way_is_named_and_nothing_is_lost(
    tmp_path: Path, device: str, word: str
) -> None:
    async def story(one: Story) -> None:
        first = await one.run(one.session(Helper()))
        helper = Helper("Homing: zed", lambda: one.cell.befall("power", device=device))
        record = await one.run(one.session(helper))
        assert record.outcome in (StepEnd.FAILED, StepEnd.BROKEN_OFF)
        assert re.search(word, record.message), record.message
        kept = one.order.folder.path / first.evidence / "record.json"
        assert StepRecord.model_validate_json(kept.read_text()) == first

    play(tmp_path, Story, story)


def test_where_nobody_is_there_nothing_moves(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        before = one.counts()
        record = await one.run(one.session(NOBODY))
        assert record.outcome is StepEnd.BROKEN_OFF
        assert "a person is required" in record.message
        assert one.counts() == before

    play(tmp_path, Story, story)


def test_a_step_whose_needs_are_not_done_is_refused(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        standings = one.order.standings(datetime.now(UTC))
        with pytest.raises(ConfigError, match="it needs `devices`, which is not done"):
            due(standings, "light")
        with pytest.raises(ConfigError, match="the steps are devices, light"):
            due(standings, "lamp")

    play(tmp_path, Story, story)
