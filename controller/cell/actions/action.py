"""An action of the cell, and the running of one."""

from collections.abc import Mapping
from typing import Protocol

from controller.cell.errors import PartFaultError
from controller.cell.machine import NEEDS, Effect, Event

from ..services import Leases, Recoveries


class Action(Protocol):
    """The cell's work in one state; ends in one event."""

    async def run(self) -> Event:
        """Run the action; return the event in which it ends.

        Raises
        ------
        PartFaultError : the part has a fault that the cell may recover from
        PartProblemError : a person has to look at the part
        """
        ...


class Actions:
    """An action for each effect of the table.

    Raises
    ------
    ValueError : an effect has none
    """

    def __init__(
        self, by_effect: Mapping[Effect, Action], recoveries: Recoveries, leases: Leases
    ) -> None:
        if missing := set(Effect) - set(by_effect):
            raise ValueError(f"no action for {', '.join(sorted(missing))}")
        self._by_effect = by_effect
        self._recoveries = recoveries
        self._leases = leases

    async def perform(self, effect: Effect) -> Event:
        """Run one effect to its end, with its resources; return its event or its recovery's.

        Raises
        ------
        PartProblemError : a person has to look at the part
        """
        try:
            async with self._leases.hold(effect.value, NEEDS[effect]):
                return await self._by_effect[effect].run()
        except PartFaultError as error:
            action = self._recoveries.book(error)
        await self._recoveries.wait(action)
        return action.event
