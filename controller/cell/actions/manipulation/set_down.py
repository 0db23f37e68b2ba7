"""Setting down: the part goes on the table, to be recognised again and regrasped."""

from dataclasses import dataclass

from controller.cell.custody import Custody
from controller.cell.journal.rows import Intent, Once
from controller.cell.machine import Event, SafePoint
from controller.cell.services import Grippers, Motion, PlanSteps
from controller.cell.services.records import BatchRecord
from controller.planning import SetDown
from messages import key


@dataclass(frozen=True, slots=True, eq=False)
class SetDownAction:
    """Puts the part on the table.

    Attributes
    ----------
    steps, motion, grippers, record : services
    """

    steps: PlanSteps
    motion: Motion
    grippers: Grippers
    record: BatchRecord

    async def run(self) -> Event:
        """Move to the table, release, rise; return ``SET_DOWN``.

        Raises
        ------
        PartFaultError : the part was lost on the way
        """
        step = self.steps.next(SetDown)
        assert step is not None
        started_s = self.steps.begin(step)
        await self.motion.follow(step.motion)
        await self.grippers.press_and_require_hold()
        self.motion.reach(SafePoint.BEFORE_SETTING_DOWN)
        await self.motion.lower(step.motion_down)
        await self.grippers.press_and_require_hold()
        intent = Intent(name=Once.SET_DOWN, pose_index=step.pose_index)
        await self.grippers.let_go(intent, step.open_mm, step.motion_up)
        part = self.record.part
        part.laid = None if part.facts.is_turn_open else step.T_world_part
        await self.record.set_custody(Custody.ON_TABLE, key("set down"))
        await self.motion.follow(step.motion_up)
        self.steps.end(step, started_s)
        return Event.SET_DOWN
