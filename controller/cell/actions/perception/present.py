"""Presenting: views of the held part before the inspection camera."""

from dataclasses import dataclass

from controller.cell.devices.lamps import STATION_LAMPS, STATION_PANEL
from controller.cell.journal.rows import FirstMotion
from controller.cell.machine import VIEW, Event, SafePoint
from controller.cell.services import (
    Codes,
    Disambiguation,
    Gate,
    Grippers,
    Imaging,
    Motion,
    PlanSteps,
    Views,
)
from controller.cell.services.records import BatchRecord, PartInGripper
from controller.planning import Present
from controller.planning.model import lit_count
from messages import key


@dataclass(frozen=True, slots=True, eq=False)
class PresentAction:
    """Presents views to the inspection camera until one has to be judged first.

    Attributes
    ----------
    steps, motion, gate, grippers, imaging, views, record : services
    codes : reads the serial number off the part, where a code has it
    disambiguation : service that decides between the hypotheses by the view planned for it
    """

    steps: PlanSteps
    motion: Motion
    gate: Gate
    grippers: Grippers
    imaging: Imaging
    views: Views
    disambiguation: Disambiguation
    codes: Codes
    record: BatchRecord

    async def run(self) -> Event:
        """Present one view after another; return ``SHOWN``.

        After each new grasp the pose of the part in the first view has to be known before the
        second is taken: it verifies the grasp. So has that in each view until one shows a turn that
        the table left open. In a plan made after a recovery, views that would show nothing new are
        skipped; so are, once the grasp is verified, views that have failed too often in this batch.

        Raises
        ------
        PartFaultError : the part is gone, or rests in the gripper in another stable pose
        PartProblemError : it is another part
        """
        try:
            while (step := self.steps.next(Present)) is not None:
                started_s = self.steps.begin(step)
                if self._is_avoided(step):
                    self.steps.end(step, started_s, passed_by=step.view_id)
                    continue
                await self.motion.follow(step.motion)
                await self.grippers.press_and_require_hold()
                self.motion.reach(SafePoint.AT_VIEW)
                hold = self.record.held()
                if hold.is_measured and not await self.views.is_worth_showing(step):
                    self.steps.end(step, started_s, passed_by=step.view_id)
                    continue
                view = await self._show(step, hold)
                self.steps.end(step, started_s, view=view)
                self.views.take_ready()
                if (
                    not hold.is_measured
                    or self.record.part.facts.is_turn_open
                    or self.views.is_hold_questioned()
                ):
                    break
                if self.views.may_have_failed():
                    break
        finally:
            await self.imaging.pause("inspection")
        return Event.SHOWN

    def _is_avoided(self, step: Present) -> bool:
        is_needed = step.ambiguity is not None or not self.record.held().is_measured
        return not is_needed and self.record.budgets.is_demoted(VIEW + step.view_id)

    async def _show(self, step: Present, hold: PartInGripper) -> str:
        """Take the pictures of a view, have them judged in the background, return its name."""
        await self.motion.ring_down()
        await self.gate.wait(_look)
        view = self.views.name(step)
        backlit = await self.imaging.shoot("inspection", {STATION_PANEL: 1.0})
        lit = {
            lamp: await self.imaging.shoot("inspection", {lamp: 1.0}) for lamp in lamps_for(step)
        }
        q = await self.motion.read_q()
        files = {
            lamp: await self.imaging.save(self.record.part.number, f"{view}_{lamp}", image)
            for lamp, image in {STATION_PANEL: backlit, **lit}.items()
        }
        self.views.record_pictures(step, files, q)
        if step.ambiguity is not None:
            await self.disambiguation.resolve(step.ambiguity, hold, q, backlit, tuple(lit.values()))
        self.codes.read_in_view(self.views.judge_held(view, hold, q, backlit, lit), lit)
        return view


async def _look() -> FirstMotion:
    return FirstMotion(words=key("nothing moves yet: the cell takes the pictures of this view"))


def lamps_for(step: Present) -> tuple[str, ...]:
    """Return the lamps a view is lit with."""
    return STATION_LAMPS[: lit_count(is_square=step.square_to >= 0)]
