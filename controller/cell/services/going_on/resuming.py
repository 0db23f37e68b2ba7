"""The part of an interrupted run: taken over into this run's record and journal.

The rows of this run are enough for the next one to continue from, should this one be killed too.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from controller.cell.custody import Custody
from controller.cell.journal import rows
from controller.cell.machine import PARKING, Act, Event, PartFault, Recovery
from controller.cell.recovery import Interrupted, Proposal
from controller.inspection import PartVerdict, Verdict
from controller.recognition import Alternative, Sighting
from controller.setup.turns import free_turn_of
from messages import say

from ..motion import Motion
from ..records import BatchProduct, BatchRecord, PartInGripper, PartRecord, grasp_of
from ..table import Labels
from ..views import StoredViews


@dataclass(slots=True, eq=False)
class Resumption:
    """Whether, and from which state, this run begins with the part of an interrupted one.

    Attributes
    ----------
    record, motion, stored_views : take it over
    labels : labels of this run, some of which parts of the interrupted run have
    accepted : permitted ways to go on; None if the run begins as usual
    source : folder of the interrupted run
    product : product that the part belongs to
    """

    record: BatchRecord
    motion: Motion
    stored_views: StoredViews
    labels: Labels = field(default_factory=Labels)
    accepted: Proposal | None = None
    source: Path = Path()
    product: BatchProduct | None = None

    def accept(self, proposal: Proposal, source: Path, product: BatchProduct) -> None:
        """Begin with the part of an interrupted run.

        Parameters
        ----------
        proposal : permitted ways to go on with it
        source : folder of that run
        product : product of this run that the part belongs to
        """
        self.accepted, self.source = proposal, source
        # so that a stop before anything else already states where the part is
        if not proposal.is_arm_alone:
            self.record.part = _part(proposal.left)
            self.product = product

    @property
    def homes(self) -> bool:
        """Whether the arm has to home with the part before anything else."""
        return self.accepted is not None and self.accepted.homing is not None

    def first(self) -> Event:
        """Return the event with which the ready cell begins."""
        return Event.START if self.accepted is None else Event.RECOVER

    async def take_over(self) -> Proposal:
        """Take the part over, journal it, judge its views again; return the accepted proposal.

        Raises
        ------
        ValueError : nothing was accepted
        """
        proposal, self.accepted = self.accepted, None
        if proposal is None:
            raise ValueError("no part was accepted to go on with")
        left, record = proposal.left, self.record
        if proposal.is_arm_alone:
            self._restore_trail(proposal)
            return proposal
        record.note(
            rows.PartResumed(
                run=left.run, serial=left.serial, lot=left.lot, order_number=left.order_number
            )
        )
        if self.product is not None:
            record.identify_part(self.product, left.serial, left.lot)
        for number in self.labels.take_over(left.serial, left.serials):
            record.count_as_done(number)
        missing = await self.stored_views.take_over(left, self.source)
        for row in (*left.recoveries, *map(_avoided, left.avoid)):
            record.note(row)
        for hold in (left.expected_hold, left.arm_hold, left.fixed_hold):
            if hold is not None:
                record.note(hold)
        self._restore_trail(proposal)
        await self._restore_custody(left)
        # killed before this, the next start goes on from the interrupted run once more
        before = () if left.resumed is None else (left.resumed.run,)
        for run in (*before, left.run):
            record.note_followed(run, left.part)
        if missing:
            record.show(
                say(
                    "without {missing_count} views: their pictures are gone or were changed",
                    missing_count=len(missing),
                )
            )
        return proposal

    def _restore_trail(self, proposal: Proposal) -> None:
        q, way = proposal.q, proposal.leaving
        if proposal.homing is not None:
            self.motion.restore(proposal.left.trail.standing, is_free=False)
            return
        assert way is not None, "an accepted proposal has a way"
        if way.is_back:
            self.motion.restore((*reversed(way.waypoints), q), is_free=way.is_free_at_end)
        else:
            self.motion.restore((q,), is_free=False)

    async def _restore_custody(self, left: Interrupted) -> None:
        """Journal the part's custody and the interrupted step, in the interrupted run's order."""
        record, detail = self.record, say("from run {run}", run=left.run)
        if left.custody_before is not Custody.NONE:
            await record.set_custody(left.custody_before, detail)
        if left.intent is None and left.last_intent is not None and left.trail.retreat:
            await record.repeat_intent(left.last_intent)
        is_given = (left.custody_before, left.custody) == (Custody.IN_ARM, Custody.IN_BOTH)
        if is_given and left.hand_off is not None:
            await record.repeat_intent(left.hand_off)  # says how wide the fixed gripper stood
        await record.set_custody(left.custody, detail)
        if left.intent is not None:
            await record.repeat_intent(left.intent)


def park_interrupted(record: BatchRecord, reason: str) -> None:
    """Send a part that can no longer be inspected to the quarantine tray, INDETERMINATE."""
    why = say(
        "run {interrupted} was interrupted while it had the part; {reason}",
        interrupted=record.part.interrupted,
        reason=reason,
    )
    _, words = PARKING
    record.begin_recovery(Recovery(PartFault.SEEN_TOO_LITTLE, why, Act.PARK), words)


def _part(left: Interrupted) -> PartRecord:
    part = PartRecord(
        number=left.part,
        custody=left.custody,
        look_count=left.look_count,
        plan_count=left.plan_count,
        hold_count=left.hold_count,
        interrupted=left.run,
    )
    if left.sighting is not None:
        part.sighting = sighting_of(left.sighting)
        part.neighbours = left.neighbours
        if part.sighting.free_turn is not None:
            part.free_turn = replace(part.sighting.free_turn, is_shown=False)  # it is shown anew
        if left.is_ambiguous:
            part.alternatives = part.sighting.ambiguous_with
    part.code = None if left.identified is None else left.identified.code
    if part.code is not None and part.code.corners_mm:
        part.coded[part.code.text] = np.array(part.code.corners_mm)
    if part.code is not None and not part.code.picture.startswith(".."):
        picture = f"../{left.run}/{part.code.picture}"  # that run's folder is beside this one's
        part.code = part.code.model_copy(update={"picture": picture})
    part.recoveries = [
        Recovery(PartFault(one.fault), one.reason, Act(one.act)) for one in left.recoveries
    ]
    part.parked = next((one for one in part.recoveries if one.act is Act.PARK), None)
    part.avoid = set(left.avoid)
    if left.arm_hold is not None:
        part.hold = hold_of(left.arm_hold)
    if left.fixed_hold is not None:
        part.fixed_grasp = grasp_of(left.fixed_hold.grasp)
    return part


def verdict_of(row: rows.PartJudged) -> PartVerdict:
    """Return the verdict in a row, without its faces."""
    return PartVerdict(
        verdict=Verdict(row.verdict),
        reasons=row.reasons,
        faces=(),
        compared_fraction=row.compared_fraction,
        findings=(),
        in_sight_fraction=row.in_sight_fraction or 0.0,
        claim=row.claim,
        compared_U=row.compared_U or 0.0,
    )


def hold_of(row: rows.HoldNoted) -> PartInGripper:
    """Return a hold that a view has to verify, as the part may have slipped meanwhile."""
    T_part_tcp = np.array(row.T_part_tcp)
    return PartInGripper(grasp_of(row.grasp), T_part_tcp, row.opening_mm, number=row.number)


def _avoided(grasp: str) -> rows.GraspAvoided:
    return rows.GraspAvoided(grasp=grasp)


def sighting_of(row: rows.SightingFields) -> Sighting:
    """Return the sighting on the table that a row describes, as far as the row goes."""
    T = None if row.T_world_part is None else np.array(row.T_world_part)
    return Sighting(
        part=row.part,
        pose_index=row.pose_index,
        R=None if row.R is None else np.array(row.R),
        x_mm=row.x_mm,
        y_mm=row.y_mm,
        theta_rad=float(np.radians(row.theta_deg)),
        T_world_part=T,
        score=row.score,
        covariance=None,
        ambiguous_with=tuple(
            Alternative(
                one.part,
                one.pose_index,
                float(np.radians(one.theta_deg)),
                np.array(one.T_world_part),
            )
            for one in row.ambiguous_with
            if one.T_world_part is not None
        ),
        area_mm2=0.0,
        box_px=row.box_px,
        residual_px=float("nan") if row.residual_px is None else row.residual_px,
        reason=row.reason,
        free_share=row.free_share,
        touching_count=row.touching_count,
        is_cut=row.is_cut,
        lies_on=row.lies_on,
        is_covered=row.is_covered,
        free_turn=free_turn_of(row.free_turn),
    )
