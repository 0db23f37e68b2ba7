"""Leases: the users of devices and spaces, one at a time, on record.

Nobody can wait in a circle: all take resources in the order of `Resource`, and an owner may only
take later ones. A lease that its owner did not return, since the controller died, stays in the
journal; `cellctl recover` shows it.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from contextvars import ContextVar
from typing import Final

from controller.cell.errors import LeaseError
from controller.cell.journal import Body
from controller.cell.journal.rows import LeaseReturned, LeaseTaken
from controller.cell.machine import Resource
from drivers.clock import CellClock
from messages import say

# An action that is over gives its lease back at once; a longer wait is a bug.
PATIENCE_S: Final = 60.0


class Leases:
    """The leases of a cell.

    Parameters
    ----------
    note : takes the rows of the journal
    clock : clock of the cell
    """

    def __init__(self, note: Callable[[Body], object], clock: CellClock) -> None:
        self._note = note
        self._clock = clock
        self._locks = {resource: asyncio.Lock() for resource in Resource}
        self._owners: dict[Resource, str] = {}
        # of the running task and of those it starts
        self._mine: ContextVar[tuple[Resource, ...]] = ContextVar("leases", default=())

    @property
    def owners(self) -> dict[Resource, str]:
        """The present owner of each resource."""
        return dict(self._owners)

    @asynccontextmanager
    async def hold(self, by: str, resources: Iterable[Resource]) -> AsyncIterator[None]:
        """Hold resources while the block runs; those that this task has already count as held.

        Parameters
        ----------
        by : name of the photographer, for the journal
        resources : in any order

        Raises
        ------
        LeaseError : one was asked for that comes before one this task has, or nobody gave it back
        """
        mine = self._mine.get()
        wanted = sorted(set(resources) - set(mine), key=lambda one: one.place)
        if wanted and mine and wanted[0].place < max(one.place for one in mine):
            raise LeaseError(
                say(
                    "{by} requests the {wanted} after it took the {held}: two such "
                    "requests would wait for each other",
                    by=by,
                    wanted=wanted[0].value,
                    held=mine[-1].value,
                )
            )
        taken: list[Resource] = []
        try:
            for resource in wanted:
                await self._take(by, resource)
                taken.append(resource)
            names = tuple(one.value for one in taken)
            if taken:
                self._note(LeaseTaken(by=by, resources=names))
            token = self._mine.set((*mine, *taken))
            try:
                yield
            finally:
                self._mine.reset(token)
                if taken:
                    self._note(LeaseReturned(by=by, resources=names))
        finally:
            for resource in reversed(taken):
                del self._owners[resource]
                self._locks[resource].release()

    async def _take(self, by: str, resource: Resource) -> None:
        try:
            async with self._clock.timeout(PATIENCE_S):
                await self._locks[resource].acquire()
        except TimeoutError as error:
            raise LeaseError(
                say(
                    "{by} waited {patience_s:.0f} s for the {value}, which {get} has",
                    by=by,
                    patience_s=PATIENCE_S,
                    value=resource.value,
                    get=self._owners.get(resource, "nobody"),
                )
            ) from error
        self._owners[resource] = by
