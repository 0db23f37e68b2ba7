"""`cellctl recover --accept`: whoever accepts is shown what they accept."""

from __future__ import annotations

import pytest

from controller.cell.batch import GO_ON
from controller.cell.operator import Choice, Question
from controller.cli.running.accepting import AcceptingOperator

LOOK = "Look before you accept: nobody has moved the arm."


async def test_what_is_accepted_is_printed_first_and_apart_from_the_json_lines(
    capsys: pytest.CaptureFixture[str],
) -> None:
    question = Question("part_left", f"Evidence.\n{LOOK}", (Choice(GO_ON, "go on"),))
    answer = await AcceptingOperator("it stands straight").decide(question)
    assert answer is not None
    assert (answer.key, answer.why) == (GO_ON, "it stands straight")
    printed = capsys.readouterr()
    assert LOOK in printed.err
    assert printed.out == ""


async def test_no_other_question_is_answered(capsys: pytest.CaptureFixture[str]) -> None:
    question = Question("no_part", "no part on the table", (Choice("look", "look again"),))
    assert await AcceptingOperator("").decide(question) is None
    assert capsys.readouterr().err == ""
