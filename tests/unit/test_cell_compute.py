"""The compute service has one method per answer, with the same arguments."""

from __future__ import annotations

import asyncio
import gc
import inspect
import pickle
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.compute import Compute, Job, answers, begin
from controller.cell.compute.service import ComputeCall
from controller.inspection import Kept

JOB = Job(Path("recipe.yaml"), Path("cell.yaml"))
QUESTIONS = {name: one for name, one in vars(Compute).items() if isinstance(one, ComputeCall)}


class Text(str):
    """Stands in for the parsed file of some views."""

    recipe = learned = None


class Notebook(Executor):
    """Runs nothing; keeps what it was asked, as it would travel to the worker."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def submit(self, function: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        assert not args
        assert not kwargs
        self.asked.append(pickle.loads(pickle.dumps(function)))
        done: Future[Any] = Future()
        done.set_result("answer")
        return done


@pytest.mark.parametrize("name", sorted(QUESTIONS))
def test_a_question_has_the_name_and_the_arguments_of_its_answer(name: str) -> None:
    answer = getattr(answers, name)
    job, *names = inspect.signature(answer).parameters
    assert job == "job"
    pool = Notebook()
    values = {one: np.arange(3) for one in names}
    assert asyncio.run(getattr(Compute(JOB, pool), name)(**values)) == "answer"
    (asked,) = pool.asked
    assert asked.func is answer
    assert asked.args == (JOB,)
    assert list(asked.keywords) == names


def test_every_answer_can_be_asked_for() -> None:
    public = {
        name
        for name, one in vars(answers).items()
        if inspect.isfunction(one)
        and one.__module__.startswith(answers.__name__)
        and name[0] != "_"
    }
    assert public == set(QUESTIONS)


async def test_an_answer_that_nobody_awaits_any_more_fails_in_silence_and_others_hear_of_it() -> (
    None
):
    complaints: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, about: complaints.append(about))

    async def fail() -> float:
        raise BrokenProcessPool("the worker has ended")

    task = begin(fail())
    await asyncio.wait({task})
    del task
    gc.collect()  # asyncio complains of an error that nobody took when its task goes
    assert complaints == []
    with pytest.raises(BrokenProcessPool):
        await begin(fail())


def test_work_ahead_goes_on_where_its_last_piece_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[str] = []

    def work(text: str, part: object, judging: object, kept: Kept, count: int) -> Iterator[None]:
        begun.append(text)
        for piece in range(3):
            kept.once(lambda: None, piece)
            yield

    monkeypatch.setattr(answers.views, "stored_ahead", work)
    monkeypatch.setattr(answers.views, "parse_view_set", lambda path, text: Text(text))
    monkeypatch.setattr(answers.views, "context", lambda job: SimpleNamespace(part=None))
    answers.views._work_at_hand.cache_clear()
    answers.views._kept.cache_clear()
    more = [answers.judge_ahead(JOB, Path("set"), "one grasp", 5) for _ in range(4)]
    assert more == [True, True, True, False]
    assert not answers.judge_ahead(JOB, Path("set"), "two grasps", 5)  # all of it is known
    assert begun == ["one grasp", "two grasps"]
    answers.views._work_at_hand.cache_clear()
    answers.views._kept.cache_clear()
