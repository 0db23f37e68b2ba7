"""Inspecting: the views shown so far are taken in, and what comes next is decided."""

from dataclasses import dataclass

from controller.cell.batch.records import BatchRecord, verdict_row
from controller.cell.batch.services import HeldPose, PlanSteps, Views
from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.errors import PartFaultError
from controller.cell.machine import WORTH_SHARE, Event, PartFault
from controller.planning import GiveStep, Present, ReceiveStep, SetDown


@dataclass(frozen=True, slots=True, eq=False)
class InspectAction:
    """Waits for the views shown so far; judges the part once all are in.

    Attributes
    ----------
    compute : weighs the views
    steps, views, held_pose, record : services
    """

    compute: Compute
    steps: PlanSteps
    views: Views
    held_pose: HeldPose
    record: BatchRecord

    async def run(self) -> Event:
        """Take in the views; return what the plan has next, or that all is seen.

        Raises
        ------
        PartFaultError : the part is not held as planned, or too little of it was seen
        """
        self.record.show("judging what was shown")
        await self._collect()
        if self.steps.next(Present) is not None:
            return Event.INSPECTED
        if self.steps.next(GiveStep) is not None or self.steps.next(ReceiveStep) is not None:
            return Event.HAND_OFF_DUE
        if self.steps.next(SetDown) is not None:
            return Event.SET_DOWN_DUE
        await self._require_enough()
        await self._judge()
        return Event.ALL_SEEN

    async def _collect(self) -> None:
        while (judged := await self.views.take_next()) is not None:
            shown, result = judged
            # of a hold that has been given up since nothing more need be known
            if shown.hold is not None and shown.hold is self.record.part.hold:
                await self.held_pose.learn(shown, shown.hold, result)

    async def _require_enough(self) -> None:
        """Plan once more where the views of the plan have truly shown less than they were to."""
        part = self.record.part
        promised, seen = part.promised, part.seen
        if promised is None or part.custody is not Custody.IN_ARM:
            return
        if part.has_had(PartFault.SEEN_TOO_LITTLE):
            return
        missing = await self.compute.surface_share(promised if seen is None else promised & ~seen)
        if missing >= WORTH_SHARE:
            raise PartFaultError(
                PartFault.SEEN_TOO_LITTLE,
                f"{100 * missing:.1f} % of the surface was to be shown and was not in sight",
            )

    async def _judge(self) -> None:
        part = self.record.part
        assert part.plan is not None
        unseen = {u.face_id: u.reason for u in part.plan.unseen}
        part.verdict = await self.compute.judge(tuple(part.results), unseen, dict(part.planned))
        self.record.note(verdict_row(part.verdict))
