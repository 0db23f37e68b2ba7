"""The planner's long work that needs no picture: begun early, waited for before a plan is made."""

import asyncio
from collections.abc import Sequence

from controller.cell.compute import Compute, begin


class Preparation:
    """Planning ahead of the first look at the table, for each recipe of the batch.

    Parameters
    ----------
    computes : the compute service of each recipe
    """

    def __init__(self, computes: Sequence[Compute]) -> None:
        self._computes = tuple(computes)
        self._tasks: dict[int, asyncio.Future[float]] = {}

    def begin(self) -> None:
        """Begin in the worker process, what has not begun or has failed; returns at once."""
        for number, compute in enumerate(self._computes):
            task = self._tasks.get(number)
            if task is None or (task.done() and (task.cancelled() or task.exception() is not None)):
                self._tasks[number] = begin(compute.prepare())

    async def wait(self, number: int = 0) -> None:
        """Wait until a recipe's preparation is done, if one was begun; raise its error.

        Parameters
        ----------
        number : number of the recipe in its order, from 0
        """
        task = self._tasks.get(number)
        if task is not None:
            await task
