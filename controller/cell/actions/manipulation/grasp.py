"""Grasping: the part is judged on the table, if the plan says so, and taken off it."""

from dataclasses import dataclass

from controller.cell.custody import Custody
from controller.cell.custody.release_guard import NOTHING_MM
from controller.cell.devices.lamps import TABLE_LAMPS, TABLE_PANEL
from controller.cell.errors import PartFaultError
from controller.cell.journal.rows import GraspMissed, Once
from controller.cell.machine import GRASP, Event, PartFault, SafePoint
from controller.cell.services import Grippers, Motion, PlanSteps, Views
from controller.cell.services.records import BatchRecord
from controller.cell.services.table import Taking
from controller.planning import Look, Pick
from controller.planning.model import CellLayout
from messages import key, say


@dataclass(frozen=True, slots=True, eq=False)
class GraspAction:
    """Takes the part off the table and proves that it is held.

    Attributes
    ----------
    steps, motion, grippers, views, record : services
    taking : begins to plan the next part once this one is held
    layout : layout with the configuration to park in
    """

    steps: PlanSteps
    motion: Motion
    grippers: Grippers
    views: Views
    record: BatchRecord
    taking: Taking
    layout: CellLayout

    async def run(self) -> Event:
        """Go to the part, close on it, lift it; return ``GRASPED``.

        Raises
        ------
        PartFaultError : the jaws closed on nothing, or on something else
        """
        self._judge_on_table()
        step = self.steps.next(Pick)
        assert step is not None
        started_s = self.steps.begin(step)
        await self.grippers.open_arm(step.pre_open_mm)
        await self.motion.follow(step.motion_in)
        self.motion.reach(SafePoint.ABOVE_TABLE)
        await self.motion.follow(step.motion_down)
        self.record.expect_hold(step.grasp)
        opening_mm = await self.grippers.close_arm(
            Once.GRASP, step.expected_opening_mm, step.motion_up
        )
        await self._check_opening(step, opening_mm)
        self.record.take_hold(step.grasp, opening_mm)
        await self.record.set_custody(
            Custody.IN_ARM, say("jaws at {opening_mm:.1f} mm", opening_mm=opening_mm)
        )
        self.taking.look_ahead()
        await self.motion.follow(step.motion_up)
        await self.grippers.press_and_require_hold()
        self.steps.end(
            step, started_s, jaw_mm=round(opening_mm, 2), expected_mm=step.expected_opening_mm
        )
        return Event.GRASPED

    def _judge_on_table(self) -> None:
        """Have the latest pictures of the table judged as views while the arm grasps."""
        part = self.record.part
        while (look := self.steps.next(Look)) is not None:
            started_s = self.steps.begin(look)
            view = self.views.name(look)
            self.views.record_pictures(look, part.picture_names)
            # only the ring: things around the table cast shadows in the side lamp's light, and no
            # prediction has them
            lit = {lamp: part.pictures[lamp] for lamp in TABLE_LAMPS[:1]}
            self.views.judge_on_table(view, look, part.pictures[TABLE_PANEL], lit)
            self.steps.end(look, started_s, view=view)

    async def _check_opening(self, step: Pick, opening_mm: float) -> None:
        """Leave the part in place unless the jaws stopped where the plan expects them to."""
        expected = say(
            "{expected_opening_mm:.1f} mm was expected",
            expected_opening_mm=step.expected_opening_mm,
        )
        beyond_mm = self.grippers.beyond_mm(opening_mm, step.expected_opening_mm)
        if beyond_mm < 0.0:
            found = (
                key("on nothing")
                if opening_mm < NOTHING_MM
                else say("to {opening_mm:.1f} mm", opening_mm=opening_mm)
            )
            message = say("the jaws closed {found}, {expected}", found=found, expected=expected)
            self.record.note(GraspMissed(message=message))
            await self._leave(step)
            raise PartFaultError(PartFault.GRASP_MISSED, message, source=GRASP + step.grasp.id)
        if beyond_mm > 0.0:
            await self._leave(step)
            raise PartFaultError(
                PartFault.GRASP_WRONG,
                say(
                    "the jaws stopped at {opening_mm:.1f} mm, {expected}: they held "
                    "other faces of the part, or another object",
                    opening_mm=opening_mm,
                    expected=expected,
                ),
                source=GRASP + step.grasp.id,
            )

    async def _leave(self, step: Pick) -> None:
        """Open, and go back along the path by which the arm came: it is free of contact."""
        await self.grippers.open_arm(step.pre_open_mm)
        await self.record.set_custody(Custody.ON_TABLE)
        await self.motion.follow(step.motion_up)
        self.motion.mark_free()
        await self.motion.follow((*reversed(step.motion_in[:-1]), self.layout.park_q))
        self.motion.mark_free()
        self.motion.reach(SafePoint.PARKED, ends_step=True)
