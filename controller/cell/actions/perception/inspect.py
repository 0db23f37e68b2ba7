"""Inspecting: learn the hold of the part from the views so far, and decide the next step."""

import asyncio
import logging
from dataclasses import dataclass, replace

from controller.cell.compute import Compute, begin
from controller.cell.custody import Custody
from controller.cell.errors import PartFaultError
from controller.cell.journal.rows import PartInspected
from controller.cell.machine import VIEW, WORTH_SHARE, Act, Event, PartFault
from controller.cell.services import (
    Codes,
    HeldPose,
    JudgingAhead,
    Motion,
    PartFileWriter,
    PlanSteps,
    Recoveries,
    Views,
    plain_name,
)
from controller.cell.services.records import (
    AboveTray,
    BatchRecord,
    findings_row,
    measured_row,
    plan_row,
    verdict_row,
    views_posed_row,
)
from controller.cell.services.trays import QUARANTINE, TRAYS
from controller.cell.services.views.part_file import WrittenViews
from controller.inspection import PartInspection, PartVerdict, Verdict
from controller.planning import (
    FaceToShowAgain,
    GiveStep,
    InArm,
    NoPlanError,
    Present,
    ReceiveStep,
    SetDown,
)
from controller.stored import lines_digest
from messages import joined, key, say

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class InspectAction:
    """Learns the hold of the part; judges the part after the last view.

    Meanwhile the arm goes on with the part to the tray that it is likely to need.

    Attributes
    ----------
    compute : judges the part from its views
    steps, views, held_pose, ahead, motion, record : services
    recoveries : recovery actions for a part of which too little was visible
    part_file : writes the views that the part is judged from
    codes : read while the views were taken; a part that must have a number and has none is not
        accepted
    """

    compute: Compute
    steps: PlanSteps
    views: Views
    held_pose: HeldPose
    ahead: JudgingAhead
    motion: Motion
    record: BatchRecord
    recoveries: Recoveries
    part_file: PartFileWriter
    codes: Codes

    async def run(self) -> Event:
        """Learn the part's pose from the views; return the plan's next event, or that all is seen.

        Their results are waited for only after the last one.

        Raises
        ------
        PartFaultError : the part is not held as planned, or too little of it was in sight
        """
        self.record.show(key("judging the views"))
        await self._learn()
        self.views.take_ready()
        if await self._has_failed():
            await self._conclude()
            return Event.ALL_SEEN
        if self.steps.next(Present) is not None:
            return Event.INSPECTED
        if self.steps.next(GiveStep) is not None or self.steps.next(ReceiveStep) is not None:
            self.ahead.begin()
            return Event.HAND_OFF_DUE
        if self.steps.next(SetDown) is not None:
            self.ahead.begin()
            return Event.SET_DOWN_DUE
        self.ahead.drop()
        part = self.record.part
        if part.parked is None or part.judged or part.pending:
            judging = begin(self._judge())
            try:
                await self._go_on()
                await judging
            finally:
                judging.cancel()
        if part.parked is not None:
            part.verdict = _kept_back(
                part.verdict, say("parked: {reason}", reason=part.parked.reason)
            )
        await self._conclude()
        return Event.ALL_SEEN

    async def _conclude(self) -> None:
        """Journal the verdict; a part that is not identified is not accepted."""
        part = self.record.part
        assert part.verdict is not None
        reason = "" if part.parked is not None else await self.codes.settle()
        if reason:
            part.verdict = _kept_back(part.verdict, reason)
        self.record.note(verdict_row(part.verdict))

    async def _learn(self) -> None:
        while (learned := await self.views.learn_next()) is not None:
            shown, found = learned
            source = VIEW + plain_name(shown.view)
            if found.evaluated:
                self.record.budgets.succeed(source)
            else:
                self.recoveries.fail(source, found.reason)
            # a view of an earlier grasp says nothing about the present one
            if shown.hold is not None and shown.hold is self.record.part.hold:
                await self.held_pose.learn(shown, shown.hold, found)

    async def _require_enough(self) -> None:
        """Raise PartFaultError if views showed less than promised, unless policy accepts that."""
        part = self.record.part
        promised, in_sight = part.promised, part.in_sight
        if promised is None or not self._may_show_more():
            return
        missing = await self.compute.surface_share(
            promised if in_sight is None else promised & ~in_sight
        )
        if missing >= WORTH_SHARE:
            raise PartFaultError(
                PartFault.SEEN_TOO_LITTLE,
                say(
                    "{missing_percent:.1f} % of the planned surface was not in sight",
                    missing_percent=100 * missing,
                ),
            )

    def _may_show_more(self) -> bool:
        """Return whether the part may be shown again; if not, open findings end INDETERMINATE."""
        part = self.record.part
        return (
            part.parked is None
            and part.custody is Custody.IN_ARM
            and self.recoveries.decision(PartFault.SEEN_TOO_LITTLE) is not Act.SKIP
        )

    async def _has_failed(self) -> bool:
        """Return whether the part has failed by the views so far and goes to a tray from here.

        Only where the recipe asks for it, and the arm has the part with views still to show.
        """
        part = self.record.part
        left = part.presents_left
        if not self.views.may_have_failed() or not left or self._is_elsewhere():
            return False
        part.suspect_count = part.suspects
        self.ahead.drop()
        stored, found = await self._judged()
        if found.verdict is not Verdict.FAIL:
            return False
        hold = self.record.held()
        grasp = replace(hold.grasp, T_part_tcp=hold.T_part_tcp, opening_mm=hold.opening_mm)
        start = InArm(grasp, await self.motion.read_q())
        try:
            plan = await self.compute.plan_to_trays(
                start, frozenset(part.avoid), self.record.around
            )
        except NoPlanError as error:
            log.info("the part has failed and is shown to the end: %s", error)
            return False
        part.plan, part.next_step, part.above_tray = plan, 0, None
        part.plan_count += 1
        self.record.note(plan_row(plan, is_ahead=False))
        self.views.take_judged(found.views)
        await self._keep(
            stored, found, (say("put down as it had failed; views not shown: {left}", left=left),)
        )
        return True

    def _is_elsewhere(self) -> bool:
        part = self.record.part
        return part.parked is not None or part.custody is not Custody.IN_ARM

    async def _judge(self) -> None:
        stored, found = await self._judged()
        self.views.take_judged(found.views)
        await self._require_enough()
        self._require_all_compared(found)
        await self._keep(stored, found)

    async def _judged(self) -> tuple[WrittenViews, PartInspection]:
        """Return the file of the part's views so far, and the judgement by them."""
        part, record = self.record.part, self.record
        await self.codes.collect()  # where the code is, the pictures are not compared
        stored = await asyncio.to_thread(self.part_file.write, part, record.product)
        return stored, await self.compute.judge(self.part_file.folder / stored.file)

    async def _keep(
        self, stored: WrittenViews, found: PartInspection, more: tuple[str, ...] = ()
    ) -> None:
        """Keep a judgement as the part's, with further reasons."""
        part, record = self.record.part, self.record
        record.note_file(stored.file, stored.digest)
        reasons = (*found.reasons, *found.unproven, *more)
        part.verdict = replace(found.ledger, verdict=found.verdict, reasons=reasons)
        # in a thread: thousands of looks take longer to describe than the event loop may be held
        record.note(await asyncio.to_thread(measured_row, found.measured))
        record.note(findings_row(found.findings))
        record.note(views_posed_row(found.off))
        record.note(PartInspected(views=stored.file, lines_sha256=lines_digest(found)))

    def _require_all_compared(self, found: PartInspection) -> None:
        """Raise PartFaultError if a face could hardly be compared and nothing has failed.

        From another grasp the light on it differs, and the gripper is elsewhere.
        """
        part, short = self.record.part, found.ledger.short_faces
        if not short or found.verdict is not Verdict.INDETERMINATE or not self._may_show_more():
            return
        assert part.plan is not None
        part.short |= {
            FaceToShowAgain(grasp.id, face) for grasp in part.plan.grasps for face in short
        }
        labels = {face.face_id: face.label for face in found.ledger.faces}
        raise PartFaultError(
            PartFault.SEEN_TOO_LITTLE,
            say(
                "{labels}: too little was compared; to be inspected again from another grasp",
                labels=joined(", ", (labels[face] for face in short)),
            ),
        )

    async def _go_on(self) -> None:
        """Go above the tray of an accepted or parked part; nothing opens there.

        The path is that of the plan to this tray. With another verdict the arm goes back along it,
        which is as free as before, and then to the right tray.
        """
        part = self.record.part
        if part.custody is not Custody.IN_ARM or part.plan is None or part.above_tray is not None:
            return
        tray = QUARANTINE if part.parked else TRAYS[Verdict.PASS]
        started_s = self.steps.clock.now_s()
        await self.motion.follow(part.plan.place[tray].motion)
        part.above_tray = AboveTray(tray, started_s)


def _kept_back(judged: PartVerdict | None, reason: str) -> PartVerdict:
    """Return the verdict on a part that a person decides on; but a failure stays a failure."""
    if judged is None:
        return PartVerdict(Verdict.INDETERMINATE, (reason,), (), 0.0, ())
    verdict = Verdict.FAIL if judged.verdict is Verdict.FAIL else Verdict.INDETERMINATE
    return replace(judged, verdict=verdict, reasons=(reason, *judged.reasons))
