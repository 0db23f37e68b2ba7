"""`cellctl watch`: what it prints of a run that begins, changes, falls silent and ends."""

import json
from pathlib import Path
from typing import Any

import pytest

from controller.cell.control import ControlError, NoRunError
from controller.cell.control.words import (
    ChoiceReply,
    HolderReply,
    QuestionReply,
    StatusReply,
)
from controller.cli.acting import watching

RUN = "20260101-120000-000-plate"


def status(**more: Any) -> StatusReply:
    known: dict[str, Any] = {
        "run": RUN, "at_s": 1.0, "state": "presenting", "label": "show with grasp A1", "step": 2,
        "step_count": 9, "custody": "in the arm gripper", "seconds_left": 40.0, "message": "",
        "safe_point": None, "pausing": None, "pause_seconds": {}, "first_motion": None,
        "question": None, "alarms": (),
        "holder": HolderReply(run=RUN, user="u", host="h", pid=1, since="now"),
    }  # fmt: skip
    return StatusReply(**(known | more))


class Wall:
    """A clock that goes on only while somebody waits."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def wait(self, seconds: float) -> None:
        self.now_s += seconds


def watch(
    monkeypatch: pytest.MonkeyPatch, answers: list[StatusReply | Exception], as_json: bool = False
) -> tuple[int, int]:
    """Return the exit code, and how many answers were left."""
    left = list(answers)

    class Cell:
        def __init__(self, runs: Path) -> None:
            assert runs == Path("runs")

        def status(self) -> StatusReply:
            answer = left.pop(0)
            if isinstance(answer, Exception):
                raise answer
            return answer

    monkeypatch.setattr(watching, "RunningCell", Cell)
    wall = Wall()
    code = watching.watch_cell(
        Path("runs"), as_json=as_json, wait=wall.wait, clock=lambda: wall.now_s
    )
    return code, len(left)


def test_each_change_is_one_line_and_the_clock_alone_is_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = [
        status(), status(at_s=1.5, seconds_left=39.5), status(step=3, seconds_left=30.0),
        NoRunError("ended"),
    ]  # fmt: skip
    assert watch(monkeypatch, answers) == (0, 0)
    assert capsys.readouterr().out.splitlines() == [
        "presenting 2/9: show with grasp A1 (40 s left) | in the arm gripper",
        "presenting 3/9: show with grasp A1 (30 s left) | in the arm gripper",
        f"run {RUN} has ended; `cellctl report {RUN} --runs runs` has its result",
    ]


def test_a_question_comes_with_its_choices_and_an_alarm_goes_to_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    question = QuestionReply(
        number=4,
        code="tray_full",
        text="tray accept (4 parts) is full.",
        choices=(ChoiceReply(key="look", words="they are empty now", first=""),),
    )
    held = status(state="held", question=question, alarms=("424 tray_full",))
    assert watch(monkeypatch, [held, held, NoRunError("ended")]) == (0, 0)
    out, err = capsys.readouterr()
    assert "question 4: tray accept (4 parts) is full." in out
    assert "cellctl answer look   they are empty now" in out
    assert err.count("alarm 424 tray_full") == 1


def test_objects_with_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    watch(monkeypatch, [status(), status(at_s=9.0), NoRunError("ended")], as_json=True)
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["event"] for line in lines] == ["status", "ended"]
    assert (lines[0]["step"], lines[1]["run"]) == (2, RUN)


def test_a_run_that_falls_silent_for_a_moment_is_watched_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    silent = [ControlError("busy")] * 100  # 25 s
    assert watch(monkeypatch, [status(), *silent, status(), NoRunError("ended")]) == (0, 0)


def test_a_run_that_stays_silent_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ControlError, match="busy"):
        watch(monkeypatch, [status(), *[ControlError("busy")] * 1000])


def test_without_a_run_there_is_nothing_to_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NoRunError):
        watch(monkeypatch, [NoRunError("none")])


def test_the_next_run_is_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = [status(), status(run="20260101-130000-000-plate"), status()]
    assert watch(monkeypatch, answers) == (0, 1)
