"""The action that decides how to go on, from whoever has the part, as it is measured."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from controller.imaging import inverse_pose
from controller.planning import (
    InArm,
    InFixture,
    Look,
    NoPlanError,
    OnTable,
    Plan,
    Present,
    Start,
    shown_pose,
)
from controller.planning.motion import tip_pose

from .custody import Custody
from .errors import PartProblemError, PartTroubleError
from .holder import holder_boxes
from .machine import Event
from .records import describe_plan
from .recovery import WORTH_SHARE, Trouble, merged
from .showing import SETTLE_S, Showing

log = logging.getLogger(__name__)

Mask = NDArray[np.bool_]

SAME_PLACE = np.array([0.01, 0.01, 0.01, 0.5, 0.01, 0.01])  # [rad, mm] of joints: servo and counts


class Deciding(Showing):
    """What is to be done next, and from where."""

    async def plan(self) -> Event:
        """Decide how to go on from whoever has the part, leaving out what has been seen."""
        self._tell("planning")
        part, before = self.part, self.part.plan
        await self._collect(learn=False)
        await self._measure_hold()
        start = await self._start()
        try:
            if self._preparing is not None:
                await self._preparing
            plan = await self._experts.plan(
                start, part.seen, frozenset(part.avoid), part.candidates
            )
        except NoPlanError as error:
            return self._plan_failed(error, start, before)
        is_more = part.recoveries and part.recoveries[-1].trouble is Trouble.SEEN_TOO_LITTLE
        if is_more and await self._experts.share(_new(plan, part.seen)) < WORTH_SHARE:
            return Event.PLANNED_ON  # nothing to be gained: the plan there was goes on to its end
        part.plan, part.next_step = plan, 0
        part.plan_count += 1
        self._journal.record("decision", "plan", describe_plan(plan), part.number)
        return Event.PLANNED if isinstance(start, OnTable) else Event.PLANNED_ON

    async def _measure_hold(self) -> None:
        """Look how the part is held, where the arm stands before the camera just now.

        Raises
        ------
        PartTroubleError : it is not seen in the hand
        """
        hold, shown = self.part.hold, self._last_shown
        if hold is None or hold.is_seen or shown is None:
            return
        q = await self._devices.arm.read_q()
        if (np.abs(q - shown.q) > SAME_PLACE).any():
            return
        await self._clock.sleep(SETTLE_S)
        backlit = await self._shoot("inspection", {"station_backlight": 1.0})
        expected = shown_pose(self._layout, q, hold.T_part_hand)
        holder = holder_boxes(self._layout, q, hold.width_mm)
        found = await self._experts.find_hold(expected, hold.T_part_hand, holder, backlit)
        if found is None:
            raise PartTroubleError(
                Trouble.NOT_IN_HAND, "the camera does not see the part in the hand"
            )
        hold.T_part_hand = inverse_pose(found) @ tip_pose(self._layout, q)
        hold.is_seen = True

    async def _start(self) -> Start:
        """Return who has the part, as measured."""
        part = self.part
        match part.custody:
            case Custody.ON_TABLE:
                sighting = part.sighting
                assert sighting is not None
                assert sighting.T_world_part is not None
                return OnTable(sighting.pose_index, sighting.T_world_part)
            case Custody.IN_ARM:
                hold = self._held()
                grip = replace(hold.grip, T_part_hand=hold.T_part_hand, opening_mm=hold.width_mm)
                return InArm(grip, await self._devices.arm.read_q())
            case Custody.IN_FIXTURE if part.fixture_grip is not None:
                return InFixture(part.fixture_grip, await self._devices.arm.read_q())
        raise PartProblemError("no_plan", f"the part is {part.custody.value}: nothing to plan from")

    def _plan_failed(self, error: NoPlanError, start: Start, before: Plan | None) -> Event:
        """Go on with the plan there was, where the part is still held; ask a person otherwise.

        A failed hand-off left the arm where that step began, so that it may be tried once more.
        """
        if isinstance(start, OnTable) or before is None:
            raise PartProblemError("no_plan", str(error)) from error
        log.info("no new plan (%s): on with the one there was", error)
        self._journal.record("decision", "plan_kept", {"reason": str(error)}, self.part.number)
        return Event.PLANNED_ON


def _new(plan: Plan, seen: Mask | None) -> Mask:
    """Return which samples (n,) a plan shows that have not been seen."""
    promised = merged([s.seen for s in plan.steps if isinstance(s, Present | Look)])
    if promised is None:
        return np.zeros(0 if seen is None else len(seen), dtype=bool)
    return promised if seen is None else promised & ~seen
