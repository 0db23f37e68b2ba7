"""Planning: the next steps, from the gripper or table that has the part, as measured."""

import logging
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray
from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.errors import PartProblemError
from controller.cell.journal.rows import PlanKept
from controller.cell.machine import WORTH_SHARE, Event, PartFault
from controller.planning import (
    InArm,
    InFixedGripper,
    Look,
    NoPlanError,
    OnTable,
    Plan,
    Present,
    Start,
)
from messages import say

from ..services import HeldPose, Motion, Preparation, Views, park_interrupted
from ..services.records import BatchRecord, merged, plan_row
from ..services.table import Taking

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class PlanAction:
    """Plans the views still to do; surface already in sight is left out.

    Attributes
    ----------
    compute, preparation : make the plan
    taking : goes on with another part where there is no plan for this one
    views : collected first, so that nothing is shown twice
    held_pose : measures how the part is held
    motion : present joints of the arm
    record : record of the part
    """

    compute: Compute
    preparation: Preparation
    taking: Taking
    views: Views
    held_pose: HeldPose
    motion: Motion
    record: BatchRecord

    async def run(self) -> Event:
        """Collect all views, measure an unknown grasp, plan; return ``PLANNED`` or ``PLANNED_ON``.

        Raises
        ------
        PartFaultError : the part is not seen in the arm gripper
        PartProblemError : no plan, and none to go on with
        """
        self.record.show("planning")
        part, before = self.record.part, self.record.part.plan
        # these views are of an earlier plan: below, the hold is measured anew
        await self.views.take_all()
        # of a part that may be another one nobody knows what its outline should be
        if part.parked is None or part.parked.fault is not PartFault.AMBIGUOUS:
            await self.held_pose.measure_again()
        start = await self._start()
        try:
            plan, start = await self._plan_what_can_be_taken(start)
        except NoPlanError as error:
            if not part.interrupted or part.parked is not None or before is not None:
                return self._keep_plan(error, start, before)
            # nothing was planned from here before, so there is no plan to go on with
            park_interrupted(self.record, say("from where it left the part: {error}", error=error))
            try:
                plan = await self._plan(start)
            except NoPlanError as none:
                return self._keep_plan(none, start, before)
        is_more = (  # a part taken over from an interrupted run has no old plan to finish
            before is not None
            and part.parked is None
            and part.recoveries
            and part.recoveries[-1].fault is PartFault.SEEN_TOO_LITTLE
        )
        if is_more and not await self._is_worth(plan):
            return Event.PLANNED_ON  # the new plan would gain too little: finish the old one
        part.plan, part.next_step, part.above_tray = plan, 0, None
        part.plan_count += 1
        self.record.note(plan_row(plan, is_ahead=plan is part.plan_ahead))
        part.plan_ahead = None
        return Event.PLANNED if isinstance(start, OnTable) else Event.PLANNED_ON

    async def _is_worth(self, plan: Plan) -> bool:
        """Return whether a plan shows enough new surface, or shows faces from other grasps."""
        part = self.record.part
        if part.short:
            return bool(plan.presents)
        return await self.compute.surface_share(_new(plan, part.in_sight)) >= WORTH_SHARE

    async def _plan_what_can_be_taken(self, start: Start) -> tuple[Plan, Start]:
        """Return a plan and its start; for another part on the table if this one has none.

        Raises
        ------
        NoPlanError : there is none for any
        """
        while True:
            try:
                await self.preparation.wait(self.record.product.number)
                return await self._plan(start), start
            except NoPlanError as error:
                if not await self.taking.leave(str(error)):
                    raise
                start = await self._start()

    async def _plan(self, start: Start) -> Plan:
        """Return a plan without the grasps that have failed; with those of other parts, if needed.

        Raises
        ------
        NoPlanError : there is none
        """
        part, avoided = self.record.part, self.record.budgets.grasps
        if part.plan_ahead is not None and part.parked is None and isinstance(start, OnTable):
            return part.plan_ahead
        own, around = frozenset(part.avoid), self.record.around
        for avoid in (own | avoided, own):
            try:
                if part.parked is not None:
                    return await self.compute.plan_to_trays(start, avoid, around)
                return await self.compute.plan(
                    start, part.in_sight, avoid, part.alternatives, around, part.short
                )
            except NoPlanError:
                if avoid == own:
                    raise
                log.info("no plan without %s: they are used after all", ", ".join(sorted(avoided)))
        raise AssertionError("the second try returns or raises")

    async def _start(self) -> Start:
        """Return the gripper or table that has the part, with its measured pose."""
        part = self.record.part
        match part.custody:
            case Custody.ON_TABLE:
                sighting = part.sighting
                assert sighting is not None
                assert sighting.T_world_part is not None
                return OnTable(sighting.pose_index, sighting.T_world_part)
            case Custody.IN_ARM:
                hold = self.record.held()
                grasp = replace(hold.grasp, T_part_tcp=hold.T_part_tcp, opening_mm=hold.opening_mm)
                return InArm(grasp, await self.motion.read_q())
            case Custody.IN_FIXED if part.fixed_grasp is not None:
                return InFixedGripper(part.fixed_grasp, await self.motion.read_q())
        raise PartProblemError(
            "no_plan",
            say(
                "no plan begins with a part whose custody is {value}; take it out "
                "of the cell and start again",
                value=part.custody.value,
            ),
        )

    def _keep_plan(self, error: NoPlanError, start: Start, before: Plan | None) -> Event:
        """Keep the old plan while a gripper has the part; otherwise call for a person.

        After a failed hand-off the arm stands where that step began, so it can be tried again.
        """
        parked = self.record.part.parked
        if parked is not None:
            raise PartProblemError(
                parked.fault.value,
                say(
                    "{reason}; the part cannot be parked: {error}",
                    reason=parked.reason,
                    error=error,
                ),
            ) from error
        if isinstance(start, OnTable) or before is None:
            raise PartProblemError("no_plan", str(error)) from error
        log.info("no new plan (%s): continuing with the previous one", error)
        self.record.note(PlanKept(reason=str(error)))
        return Event.PLANNED_ON


def _new(plan: Plan, in_sight: BoolArray | None) -> BoolArray:
    """Return a mask (n,) of the samples that a plan would cover for the first time."""
    promised = merged([s.seen for s in plan.steps if isinstance(s, Present | Look)])
    if promised is None:
        return np.zeros(0 if in_sight is None else len(in_sight), dtype=bool)
    return promised if in_sight is None else promised & ~in_sight
