"""Slow questions to the worker process, one at a time."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


class Background:
    """Puts slow questions one after the other, so that a quick one waits for one at most.

    The worker process answers in the order in which it is asked. What the arm waits for is asked at
    once; what it does not wait for is asked here.
    """

    def __init__(self) -> None:
        self._lane = asyncio.Lock()

    async def put(
        self,
        question: Callable[Arguments, Coroutine[Any, Any, Answer]],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Answer:
        """Return the answer to a question.

        Parameters
        ----------
        question : of the compute service
        *args, **kwargs : its arguments
        """
        async with self._lane:
            return await question(*args, **kwargs)
