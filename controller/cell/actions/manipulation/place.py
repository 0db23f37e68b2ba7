"""Placing: the part goes into the tray that its verdict names."""

from dataclasses import dataclass

from controller.cell.custody import Custody
from controller.cell.journal.rows import Intent, Once
from controller.cell.machine import Event, SafePoint
from controller.cell.services import Grippers, Motion, PlanSteps
from controller.cell.services.records import BatchRecord
from controller.cell.services.trays import QUARANTINE, TRAYS
from controller.planning import Place


@dataclass(frozen=True, slots=True, eq=False)
class PlaceAction:
    """Puts the part into the tray of its verdict.

    Attributes
    ----------
    steps, motion, grippers, record : services
    """

    steps: PlanSteps
    motion: Motion
    grippers: Grippers
    record: BatchRecord

    async def run(self) -> Event:
        """Move over the tray, release, park the arm; return ``PLACED``.

        A parked part goes into the quarantine tray, whatever its verdict.

        Raises
        ------
        PartFaultError : the part was lost on the way
        """
        part = self.record.part
        plan, verdict = part.plan, part.verdict
        assert plan is not None
        assert verdict is not None
        tray = QUARANTINE if part.parked else TRAYS.get(verdict.verdict, QUARANTINE)
        step = plan.place[tray]
        started_s = await self._go_above(step)
        await self.grippers.press_and_require_hold()
        self.motion.reach(SafePoint.BEFORE_PLACING)
        await self.motion.lower(step.motion_down)
        await self.grippers.press_and_require_hold()
        # before the jaws open: a nest counted as taken too early harms nothing
        if part.sighting is not None and part.sighting.part is not None:
            self.record.note_stored(tray, part.sighting.part, step.T_world_part)
        intent = Intent(name=Once.SORT, tray=tray)
        await self.grippers.let_go(intent, step.open_mm, step.motion_up)
        part.tray = tray
        await self.record.set_custody(Custody.PLACED, tray)
        await self.motion.follow(step.motion_up)
        self.steps.end(step, started_s, tray=tray)
        await self.motion.follow(plan.park[tray].motion)
        self.motion.mark_free()
        self.motion.reach(SafePoint.PARKED, ends_step=True)
        return Event.PLACED

    async def _go_above(self, step: Place) -> float:
        """Go above the tray, unless the arm is there already; return the motion's start time."""
        part, plan = self.record.part, self.record.part.plan
        started_s = self.steps.begin(step)
        there, part.above_tray = part.above_tray, None
        if there is not None and there.tray == step.tray:
            return there.started_s
        if there is not None and plan is not None:
            await self.motion.go_back(len(plan.place[there.tray].motion))
        await self.motion.follow(step.motion)
        return started_s
