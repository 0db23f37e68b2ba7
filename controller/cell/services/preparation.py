"""The planner's long work that needs no picture: begun early, waited for before a plan is made."""

import asyncio

from controller.cell.compute import Compute, begin


class Preparation:
    """Planning ahead of the first look at the table."""

    def __init__(self, compute: Compute) -> None:
        self._compute = compute
        self._task: asyncio.Future[float] | None = None

    def begin(self) -> None:
        """Begin in the worker process, unless it has begun and not failed; returns at once."""
        task = self._task
        if task is None or (task.done() and (task.cancelled() or task.exception() is not None)):
            self._task = begin(self._compute.prepare())

    async def wait(self) -> None:
        """Wait until it is done, if it was begun; raise what it raised."""
        if self._task is not None:
            await self._task
