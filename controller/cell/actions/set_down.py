"""Setting down: the part goes on the table, to be looked at and taken with another grasp."""

from controller.planning import SetDown

from ..custody import Custody
from ..journal.rows import Intent, Once
from ..machine import Event
from ..services import BatchRecord, Grippers, Motion, PlanSteps


class SetDownAction:
    """Puts the part on the table.

    Parameters
    ----------
    steps, motion, grippers, record : services
    """

    def __init__(
        self, steps: PlanSteps, motion: Motion, grippers: Grippers, record: BatchRecord
    ) -> None:
        self._steps = steps
        self._motion = motion
        self._grippers = grippers
        self._record = record

    async def run(self) -> Event:
        """Go there, let go, rise.

        Raises
        ------
        PartFaultError : the part was lost on the way
        """
        step = self._steps.next(SetDown)
        assert step is not None
        started_s = self._steps.begin(step)
        await self._motion.follow(step.motion)
        await self._motion.follow(step.motion_down)
        await self._grippers.require_arm_holds()
        intent = Intent(name=Once.SET_DOWN, pose_index=step.pose_index)
        await self._grippers.let_go(intent, step.open_mm)
        await self._record.set_custody(Custody.ON_TABLE, "set down")
        await self._motion.follow(step.motion_up)
        self._steps.end(step, started_s)
        return Event.SET_DOWN
