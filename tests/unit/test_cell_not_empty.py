"""A part in the fixed gripper before homing: the question, and what looking again does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from controller.cell.actions import ConsultAction, HomeAction
from controller.cell.batch import BatchEnd, Dispatcher
from controller.cell.errors import PartProblemError
from controller.cell.journal import Journal, read_rows
from controller.cell.machine import Effect, Event
from controller.cell.operator import Answer, Question
from controller.cell.operator.questions import LOOK, NOT_EMPTY, question_for
from controller.cell.services import Gate, Grippers, Permits, Retries, fault_policy
from controller.cell.services.motion import homing_preview
from controller.cell.services.records import BatchRecord, RunProgress
from controller.config import FaultsSection
from drivers.clock import CellClock
from drivers.kinds import Signal

ANY: Any = SimpleNamespace


class Cell:
    """A fixed gripper that may hold something, and a person who takes it out and answers."""

    def __init__(self, folder: Path) -> None:
        clock = CellClock(1000.0)
        self.journal = Journal(folder / "journal.sqlite", "run")
        self.has_contact = True
        self.is_seen = False
        self.moved: list[str] = []
        self.questions: list[Question] = []
        self.answers: list[tuple[str, bool]] = []  # key, and whether the part is out by then
        record = BatchRecord(self.journal, RunProgress(), lambda: None)
        gate = Gate(Permits(self.journal), clock)
        io: Any = ANY(signal=self._signal)
        fixed: Any = ANY(
            status=self._status,
            activate=self._note("activate the fixed gripper"),
            open_to=self._note("open the fixed gripper"),
            max_opening_mm=85.0,
        )
        arm: Any = ANY(move_gripper_mm=self._note("open the arm gripper"))
        motion: Any = ANY(
            home=self._note("home"),
            start_from=self._note("park"),
            sweeps_to_home=True,
            homing_words="homing the arm",
            homing_preview=homing_preview,
        )
        grasp: Any = ANY(force_n=20.0, width_tolerance_mm=1.0)
        interlocks: Any = ANY(admit_jaws=lambda: None)
        grippers = Grippers(
            arm, fixed, io, record, lambda: grasp, gate, interlocks,
            Retries(record, lambda: fault_policy(FaultsSection()), clock),
        )  # fmt: skip
        layout: Any = ANY(arm_gripper=ANY(max_mm=90.0), park_q=None)
        imaging: Any = ANY(all_dark=self._nothing)
        preparation: Any = ANY(begin=lambda: None)
        home = HomeAction(
            io, layout, ANY(), motion, grippers, imaging, preparation, record, self.journal, gate
        )  # fmt: skip
        operator: Any = ANY(decide=self._decide)
        self._actions = {
            Effect.HOME: home.run,
            Effect.HOLD: self._ends(Event.HOLD_DONE),
            Effect.CONSULT: ConsultAction(
                operator,
                record,
                ANY(forget=lambda: None, begin_anew=lambda: None),
                sweeps_to_home=True,
            ).run,
            Effect.ACQUIRE: self._no_part,
            Effect.STOP_MOTION: self._ends(Event.STOP_DONE),
            Effect.ABORT_MOTION: self._ends(Event.ABORT_DONE),
        }
        actions: Any = ANY(perform=lambda effect: self._actions[effect]())
        stopping: Any = ANY(halt_arm=self._nothing, stop_others=self._nothing)
        interlocks.holding = lambda: None
        nobody: Any = None
        self.dispatcher = Dispatcher(
            actions, record, stopping, (), self.journal, gate, interlocks, nobody
        )

    def _signal(self, name: str) -> Signal:
        if name == "part_in_gripper":
            return Signal.OK if self.is_seen else Signal.NOT_OK
        return Signal.OK

    async def _status(self) -> Any:
        return ANY(
            opening_mm=30.0 if self.has_contact else 85.0,
            is_activated=True,
            has_contact=self.has_contact,
            has_arrived=not self.has_contact,
        )

    def _note(self, what: str) -> Any:
        async def move(*_: object) -> None:
            self.moved.append(what)

        return move

    async def _nothing(self) -> None:
        return None

    def _ends(self, event: Event) -> Any:
        async def run() -> Event:
            return event

        return run

    async def _no_part(self) -> Event:
        raise PartProblemError("no_part", "no part on the table")

    async def _decide(self, question: Question) -> Answer:
        self.questions.append(question)
        key, is_out = self.answers.pop(0)
        if is_out:
            self.has_contact = self.is_seen = False
        return Answer(key, "Ada")

    async def run(self, *answers: tuple[str, bool]) -> BatchEnd:
        self.answers = list(answers)
        async with asyncio.timeout(20):
            return await self.dispatcher.run()


@pytest.fixture
async def cell(tmp_path: Path) -> AsyncIterator[Cell]:
    made = Cell(tmp_path)
    yield made
    made.journal.close()


async def test_whoever_took_it_out_has_it_looked_at_again_and_the_cell_goes_on(cell: Cell) -> None:
    await cell.run(("look", True), ("stop", False))
    assert [q.code for q in cell.questions] == ["fixture_not_empty", "no_part"]
    assert [one.key for one in cell.questions[0].choices] == ["look", "stop"]
    assert "the arm homes" in dict(cell.questions[0].preview)["look"]
    assert set(cell.moved) == {
        "activate the fixed gripper", "open the fixed gripper", "home", "open the arm gripper",
        "park",
    }  # fmt: skip
    found = [r for r in read_rows(cell.journal.path) if r.name in ("reset", "permit_issued")]
    # the second reset has a permit of its own
    assert [r.name for r in found][:4] == ["reset", "permit_issued"] * 2


async def test_what_is_still_held_is_named_once_more_and_nothing_moves(cell: Cell) -> None:
    outcome = await cell.run(("look", False), ("look", False), ("stop", False))
    assert [q.code for q in cell.questions] == ["fixture_not_empty"] * 3
    assert (outcome.end, cell.moved) == ("stopped", [])


async def test_something_between_the_jaws_counts_though_they_do_not_press_on_it(cell: Cell) -> None:
    cell.has_contact, cell.is_seen = False, True
    await cell.run(("stop", False))
    assert [q.code for q in cell.questions] == ["fixture_not_empty"]
    assert cell.moved == []


def test_an_arm_of_absolute_encoders_is_not_said_to_sweep() -> None:
    for sweeps in (True, False):
        question = question_for(NOT_EMPTY, "a part", "in a gripper", sweeps_to_home=sweeps)
        assert ("sweeps" in dict(question.preview)[LOOK]) is sweeps
