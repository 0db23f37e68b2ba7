"""Consulting: the cell is on hold, and the operator decides the next step."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from controller.cell.machine import Event
from controller.cell.operator import Operator
from controller.cell.operator.questions import LOOK, NOT_EMPTY, OUT, STOP, TRAY_FULL, question_for

from ..services.records import BatchRecord
from ..services.table import Taking

EVENT_OF: Final[Mapping[str, Event]] = {
    LOOK: Event.LOOK_AGAIN,
    OUT: Event.PART_TAKEN_OUT,
    STOP: Event.STOP,
}


@dataclass(frozen=True, slots=True, eq=False)
class ConsultAction:
    """Raises the question that the present problem calls for.

    Attributes
    ----------
    operator : answers it
    record : record of the problem and the part
    taking : tries every part again once somebody has been at the table
    sweeps_to_home : whether the arm moves its joints to find their references
    """

    operator: Operator
    record: BatchRecord
    taking: Taking
    sweeps_to_home: bool

    async def run(self) -> Event:
        """Wait for an answer; return its event, ``UNATTENDED`` if nobody is there."""
        code, message = self.record.problem
        question = question_for(
            code,
            message,
            self.record.part.custody.value,
            sweeps_to_home=self.sweeps_to_home,
        )
        answer = await self.operator.decide(question)
        if answer is None:
            return Event.UNATTENDED
        self.taking.forget()
        if answer.key == LOOK:
            self.taking.begin_anew()
        # nobody believes a statement about a gripper: it is checked before anything opens
        self.record.part.is_said_to_be_out = answer.key == OUT
        if code == TRAY_FULL and answer.key == LOOK:
            await self.record.empty_trays(self.record.trays.full())
        if code == NOT_EMPTY and answer.key == LOOK:
            return Event.RESET  # reads the gripper before anything moves
        return EVENT_OF[answer.key]
