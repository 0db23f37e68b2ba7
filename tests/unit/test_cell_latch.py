"""An emergency stop or an open door bars the next start until a person acknowledges it."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cell.journal import JOURNAL_NAME, Journal, read_rows
from controller.cell.journal.rows import Acknowledged, CellEvent, RunBegan
from controller.cell.operator import (
    NOBODY,
    Answer,
    Operator,
    Question,
    acknowledge,
    fold_latch,
    require_acknowledged,
)


def record(path: Path, run: str, code: str = "", began: RunBegan | None = None) -> None:
    journal = Journal(path, run)
    journal.write(began or RunBegan(cell={"name": "cell A"}))
    if code:
        journal.write(
            CellEvent(
                name="fault", answer="handled", source="execute_grasping", target="aborting",
                message=f"{code}: why", code=code,
            )
        )  # fmt: skip
    journal.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / JOURNAL_NAME


@pytest.mark.parametrize(
    ("code", "is_latched"),
    [("estop", True), ("guard_closed", True), ("supply", False), ("stall", False), ("", False)],
)
def test_emergency_stop_and_door_are_latched_and_nothing_else(
    path: Path, code: str, is_latched: bool
) -> None:
    record(path, "one", code)
    record(path, "two")  # a later start does not take it away
    latch = fold_latch(path, "cell A")
    assert (latch is not None) == is_latched
    if latch is not None:
        assert (latch.run, latch.code) == ("one", code)
        assert "cellctl ack --why" in latch.words
    assert fold_latch(path, "cell B") is None


def test_what_was_acknowledged_bars_nothing_and_the_next_one_does_again(path: Path) -> None:
    record(path, "one", "estop")
    latch = fold_latch(path, "cell A")
    assert latch is not None
    journal = Journal(path, "ack")
    journal.write(acknowledge(latch, "ada", "looked"))
    journal.close()
    assert fold_latch(path, "cell A") is None
    record(path, "two", "guard_closed")
    again = fold_latch(path, "cell A")
    assert again is not None
    assert again.run == "two"


def test_an_emulated_cell_takes_its_emergency_stop_with_it(path: Path) -> None:
    gone = RunBegan(cell={"name": "cell A"}, emulated_devices=("io", "arm"), emulator={"pid": 7})
    record(path, "one", "estop", gone)
    assert fold_latch(path, "cell A") is None


def test_without_a_journal_nothing_is_latched(path: Path) -> None:
    assert fold_latch(path, "cell A") is None


class Person:
    """Answers the one question, and keeps it."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.questions: list[Question] = []

    async def decide(self, question: Question) -> Answer | None:
        self.questions.append(question)
        return Answer(self.key, "ada", "the cell is clear")


@pytest.mark.parametrize(
    ("operator", "starts"), [(Person("ack"), True), (Person("stop"), False), (NOBODY, False)]
)
async def test_a_start_waits_for_the_acknowledgement_and_is_barred_without_it(
    path: Path, operator: Operator, starts: bool
) -> None:
    record(path, "one", "estop")
    journal = Journal(path, "two")
    latch = await require_acknowledged(journal, "cell A", operator)
    journal.close()
    written = [(row.name, row.body["who"]) for row in read_rows(path, "two")]
    assert (latch is None) == starts
    assert (fold_latch(path, "cell A") is None) == starts
    assert written == ([(Acknowledged.row_name, "ada")] if starts else [])
