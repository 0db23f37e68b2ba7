"""At most one background task: a new one takes its place."""

import asyncio
from collections.abc import Coroutine
from typing import Any, Generic, TypeVar

from .service import begin

Answer = TypeVar("Answer")


class OneTask(Generic[Answer]):
    """Holds the task until it is taken or dropped."""

    def __init__(self) -> None:
        self._task: asyncio.Task[Answer] | None = None

    def begin(self, work: Coroutine[Any, Any, Answer]) -> None:
        """Begin work in place of any begun before; returns at once."""
        self.drop()
        self._task = begin(work)

    def take(self) -> asyncio.Task[Answer] | None:
        """Return the task and let go of it; None if there is none."""
        task, self._task = self._task, None
        return task

    def drop(self) -> None:
        """Go on with it no more."""
        if (task := self.take()) is not None:
            task.cancel()

    async def aclose(self) -> None:
        """Drop the work, and wait until none of it runs in this process."""
        task = self._task
        self.drop()
        if task is not None:
            await asyncio.gather(task, return_exceptions=True)
