"""Placing: the part goes into the tray that its verdict names."""

from controller.inspection import Verdict

from ..custody import Custody
from ..journal.rows import Intent, Once
from ..machine import Event
from ..services import BatchRecord, Grippers, Motion, PlanSteps

TRAYS = {Verdict.PASS: "accept", Verdict.FAIL: "reject"}
QUARANTINE = "quarantine"  # for every other verdict


class PlaceAction:
    """Sorts the part.

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
        """Go over the tray, let go, go where the arm is in nobody's way.

        Raises
        ------
        PartFaultError : the part was lost on the way
        """
        part = self._record.part
        plan, verdict = part.plan, part.verdict
        assert plan is not None
        assert verdict is not None
        tray = TRAYS.get(verdict.verdict, QUARANTINE)
        step = plan.place[tray]
        started_s = self._steps.begin(step)
        await self._motion.follow(step.motion)
        await self._motion.follow(step.motion_down)
        await self._grippers.require_arm_holds()
        await self._grippers.let_go(Intent(name=Once.SORT, tray=tray), step.open_mm)
        part.tray = tray
        await self._record.set_custody(Custody.PLACED, tray)
        await self._motion.follow(step.motion_up)
        self._steps.end(step, started_s, tray=tray)
        await self._motion.follow(plan.park[tray].motion)
        self._motion.mark_free()
        return Event.PLACED
