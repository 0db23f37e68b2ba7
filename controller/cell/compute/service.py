"""The compute service: functions that take seconds, run in a worker process, awaited by the cell.

Each question is declared once, by the function in `answers/` that answers it. `Compute` has a
method of the same name with the same arguments except the job, and mypy knows their types.
"""

import asyncio
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from functools import partial
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from . import answers
from .job import Job

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


class ComputeCall(Generic[Arguments, Answer]):
    """A function of `answers/` as an awaitable method of the compute service."""

    def __init__(self, answer: Callable[Concatenate[Job, Arguments], Answer]) -> None:
        self._answer = answer
        self.__doc__ = answer.__doc__

    def __set_name__(self, _: type["Compute"], name: str) -> None:
        self._name = name

    def __get__(
        self, compute: "Compute", _: type["Compute"]
    ) -> Callable[Arguments, Coroutine[Any, Any, Answer]]:
        """Return the method."""
        answering = compute.answering()
        if answering is not compute:
            method: Callable[Arguments, Coroutine[Any, Any, Answer]]
            method = getattr(answering, self._name)
            return method

        async def ask(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Answer:
            function = partial(self._answer, compute.job, *args, **kwargs)
            return await asyncio.get_running_loop().run_in_executor(compute.pool, function)

        return ask


def begin(answer: Coroutine[Any, Any, Answer]) -> asyncio.Task[Answer]:
    """Return a task that computes an answer concurrently.

    Its error is raised to the awaiting caller. Without a caller, because the run has ended, the
    error is dropped: the end of the worker process has been reported already.

    Parameters
    ----------
    answer : answer of a question
    """
    task = asyncio.ensure_future(answer)
    task.add_done_callback(lambda done: done.cancelled() or done.exception())
    return task


class Compute:
    """All questions as methods; each may take seconds, and none moves anything."""

    def __init__(self, job: Job, pool: Executor) -> None:
        self.job = job
        self.pool = pool

    def answering(self) -> "Compute":
        """Return the service that computes the answers."""
        return self

    prepare = ComputeCall(answers.prepare)
    recognise = ComputeCall(answers.recognise)
    read_codes = ComputeCall(answers.read_codes)
    plan = ComputeCall(answers.plan)
    pickable = ComputeCall(answers.pickable)
    unseen_turns = ComputeCall(answers.unseen_turns)
    plan_to_trays = ComputeCall(answers.plan_to_trays)
    identify = ComputeCall(answers.identify)
    path_home = ComputeCall(answers.path_home)
    homing_swept = ComputeCall(answers.homing_swept)
    proven_back = ComputeCall(answers.proven_back)
    locate = ComputeCall(answers.locate)
    inspect = ComputeCall(answers.inspect)
    inspect_on_table = ComputeCall(answers.inspect_on_table)
    find_hold = ComputeCall(answers.find_hold)
    judge_ahead = ComputeCall(answers.judge_ahead)
    judge = ComputeCall(answers.judge)
    surface_share = ComputeCall(answers.surface_share)


class PartCompute(Compute):
    """The compute service of the current part, looked up at each question.

    Parameters
    ----------
    service : function that returns the service for parts of the current part's recipe
    """

    def __init__(self, service: Callable[[], Compute]) -> None:
        self._service = service

    def answering(self) -> Compute:
        """Return the service of the current part."""
        return self._service()
