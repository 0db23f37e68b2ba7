"""Which views the cell weighs together for the turn of the part at hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.compute import Job, answers
from controller.cell.compute.answers import views
from controller.inspection import NotEvaluated, PartFacts
from controller.recognition import FreeTurn

JOB = Job(Path("recipe.yaml"), Path("cell.yaml"))
GUESSED = FreeTurn(np.array([0.0, 0, 1]), np.zeros(3), np.zeros(1))


@pytest.fixture
def weighed(monkeypatch: pytest.MonkeyPatch) -> list[list[Any]]:
    """The views before each one located; each leaves the turn open."""
    found: list[list[Any]] = []

    def left_open(_part: object, task: Any, _pictures: object, before: Any) -> NotEvaluated:
        found.append(list(before))
        return NotEvaluated(task.view_id, "open", np.eye(4))

    monkeypatch.setattr(views, "context", lambda _: SimpleNamespace(posed=None))
    monkeypatch.setattr(
        views, "held_task", lambda _, view_id, *_a, **_k: SimpleNamespace(view_id=view_id)
    )
    monkeypatch.setattr(views.inspecting, "locate_view", left_open)
    return found


def locate(view_id: str, free: FreeTurn | None) -> None:
    grey = np.zeros((2, 2), np.uint8)
    facts = PartFacts(free_turn=free)
    answers.locate(JOB, view_id, np.eye(4), (), grey, {}, is_hold_measured=False, facts=facts)


def test_views_of_one_guess_are_weighed_together_until_one_shows_the_turn(
    weighed: list[list[Any]],
) -> None:
    locate("T", None)
    for view_id in ("A", "B", "C"):
        locate(view_id, GUESSED)
    assert weighed[1:] == [[], ["A"], ["A", "B"]]
    # the part is expected at another turn now, and in a new grasp
    locate("D", replace(GUESSED, is_shown=True))
    assert weighed[-1] == []
    locate("E", GUESSED)
    assert weighed[-1] == []
