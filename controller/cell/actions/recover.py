"""Recovering: go on with a part that an interrupted run left in a gripper."""

from dataclasses import dataclass, replace
from typing import Final

from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal import Once
from controller.cell.journal.rows import HomingBegun, Intent
from controller.cell.machine import Event, PartFault
from controller.cell.recovery import (
    FIRST_SPEED,
    HomingWithPart,
    Opens,
    Proposal,
    WayOut,
    arm_open_mm,
)
from controller.planning.model import CellLayout
from drivers.kinds import FixedGripper
from messages import key, say

from ..services import Grippers, Motion, Resumption, hold_of, park_interrupted, verdict_of
from ..services.motion import rounded
from ..services.records import BatchRecord

# The fixed gripper stands wide open when it is within this of its widest opening.
WIDE_MM: Final = 1.0
# Which intent covers the opening of a gripper, so that a kill meanwhile is found again.
UNDOES: Final = {Opens.FIXED: Once.HAND_OFF, Opens.ARM: Once.RECEIVE}


@dataclass(frozen=True, slots=True, eq=False)
class RecoverAction:
    """Carries out an accepted proposal: confirms the holder, and moves the arm clear.

    Attributes
    ----------
    resumption : accepted proposal; takes over the part
    motion, grippers, record : services
    fixed : its opening
    compute, layout : for the way home of an empty arm
    """

    resumption: Resumption
    motion: Motion
    grippers: Grippers
    record: BatchRecord
    fixed: FixedGripper
    compute: Compute
    layout: CellLayout

    async def run(self) -> Event:
        """Return ``PLAN_VOID`` with a held part, ``PART_DROPPED`` without, ``PLACED`` in its tray.

        Raises
        ------
        PartFaultError : the part is gone from the gripper that held it
        PartProblemError : a person has to look
        """
        self.record.show(key("continuing with the part of the interrupted run"))
        proposal = await self.resumption.take_over()
        case = proposal.case
        if case.holds_as_expected:
            await self._take_expected_hold(proposal)
        if proposal.homing is not None:
            confirmed = await self._confirm_fixed(proposal)
            return await self._home(confirmed, proposal.homing)
        if case.opens is not Opens.NONE or proposal.left.intent is not None:
            await self._set_custody(proposal)
        proposal = await self._confirm_fixed(proposal)
        if proposal.custody is Custody.IN_ARM:
            await self._press(case.custody)
        await self._open(proposal)
        await self._leave(proposal)
        return await self._go_on(proposal)

    async def _home(self, proposal: Proposal, homing: HomingWithPart) -> Event:
        """Home with the grippers as they are, and confirm that their parts are still there."""
        self.record.show(key("homing with the part in a gripper; no jaw opens"))
        bounds = homing.bounds
        low, high = rounded([bounds.low, bounds.high])
        row = HomingBegun(low=low, high=high, opening_mm=bounds.arm_opening_mm)
        await self.motion.home_with_part(row, bounds.q_estimate)
        return await self._go_on(proposal)

    async def _set_custody(self, proposal: Proposal) -> None:
        """Journal who has the part, which resolves the interrupted step."""
        intent, custody = proposal.left.intent, proposal.case.custody
        detail = key("reported by the grippers after a crash")
        if custody is Custody.PLACED and intent is not None and intent.tray is not None:
            detail = intent.tray
        await self.record.set_custody(custody, detail)

    async def _take_expected_hold(self, proposal: Proposal) -> None:
        """Assume that the arm gripper closed as planned, at its present opening."""
        row = proposal.left.expected_hold
        assert row is not None
        hold = hold_of(row)
        hold.opening_mm, _ = await self.grippers.openings_mm()
        self.record.part.hold = hold
        self.record.note_hold()

    async def _confirm_fixed(self, proposal: Proposal) -> Proposal:
        """Press the fixed gripper if it reports no hold; return the event that follows.

        Nothing has moved before. If it has lost the part, the arm leaves as proposed, and the cell
        looks for the part.
        """
        hold = proposal.left.fixed_hold
        if not proposal.case.is_fixed_unconfirmed or hold is None:
            return proposal
        try:
            await self.grippers.press_fixed_and_require_hold(hold.opening_mm)
        except PartFaultError as error:
            if proposal.case.opens is Opens.NONE:
                return replace(proposal, custody=Custody.LOST)
            # the arm's fingers are round the place where the part was
            await self.record.set_custody(Custody.UNKNOWN, str(error))
            raise PartProblemError(
                "recovery_contradicted",
                say("{error}, and the arm gripper had just opened there", error=error),
            ) from error
        return proposal

    async def _press(self, custody: Custody) -> None:
        """Press the arm gripper: it closes and cannot open."""
        try:
            await self.grippers.press_and_require_hold()
        except PartFaultError as error:
            if custody is Custody.IN_ARM:
                raise
            if not await self.grippers.does_fixed_hold():
                await self.record.set_custody(Custody.UNKNOWN, str(error))
            raise PartProblemError(
                "recovery_contradicted",
                say(
                    "{error}; it was to keep the part after the hand-off that was cut off",
                    error=error,
                ),
            ) from error

    async def _open(self, proposal: Proposal) -> None:
        """Open the gripper that gives the part away, or has done so already."""
        left, opens, part = proposal.left, proposal.case.opens, self.record.part
        is_retreat = proposal.case.leaves is WayOut.BY_RETREAT
        match opens:
            case Opens.NONE:
                return
            case Opens.FIXED if is_retreat:
                assert left.last_intent is not None, "a retreat is that of an intent"
                await self.grippers.open_fixed(left.last_intent.open_mm)
            case Opens.FIXED:
                # no wider than on the way in: the arm's fingers are between its own
                open_mm = None if left.hand_off is None else left.hand_off.open_mm
                intent = Intent(name=UNDOES[opens], detail="undone", open_mm=open_mm)
                async with self.record.once(intent):
                    await self.grippers.open_fixed(open_mm)
                await self.record.set_custody(Custody.IN_ARM, key("the hand-off was reversed"))
            case Opens.ARM if is_retreat:
                await self.grippers.require_fixed_holds()
                await self.grippers.open_arm(arm_open_mm(left))
                part.hold = None
            case Opens.ARM:
                async with self.record.once(Intent(name=UNDOES[opens], detail="undone")):
                    await self.grippers.open_arm(arm_open_mm(left))
                part.hold = None
                await self.record.set_custody(
                    Custody.IN_FIXED, key("the hand-off back was reversed")
                )
            case Opens.ARM_ON_TABLE | Opens.ARM_OVER_TRAY:
                await self.grippers.open_arm(arm_open_mm(left))
                part.hold = None

    async def _leave(self, proposal: Proposal) -> None:
        """Move the arm clear of everything, slowly at first."""
        way = proposal.leaving
        assert way is not None
        if way.is_back:
            await self.motion.go_back(len(way.waypoints), FIRST_SPEED)
        elif way.waypoints:
            await self.motion.follow(way.waypoints, FIRST_SPEED)
        if way.is_free_at_end:
            self.motion.mark_free()

    async def _go_on(self, proposal: Proposal) -> Event:
        part, left = self.record.part, proposal.left
        is_held = proposal.custody in (Custody.IN_ARM, Custody.IN_FIXED)
        if is_held and left.is_ambiguous and part.parked is None:
            park_interrupted(self.record, key("no view had yet decided between parts or poses"))
        match proposal.custody:
            case Custody.IN_ARM:
                await self.grippers.press_and_require_hold()
                if proposal.case.activates_fixed:
                    await self.grippers.activate_empty_fixed()
                await self._open_fixed_wide()
                return Event.PLAN_VOID
            case Custody.IN_FIXED:
                await self.grippers.require_fixed_holds()
                return Event.PLAN_VOID
            case Custody.ON_TABLE:
                await self._open_fixed_wide()
                return Event.PART_DROPPED
            case Custody.PLACED:
                assert left.verdict is not None, "what is over its tray was judged"
                for row in (*left.judged.values(), left.verdict):
                    self.record.note(row)  # this run has the part's record, and judges no more
                part.verdict = verdict_of(left.verdict)
                part.tray = None if left.intent is None else left.intent.tray
                arm_mm, fixed_mm = await self.grippers.openings_mm()
                q = await self.motion.read_q()
                await self.motion.follow(
                    await self.compute.path_home(q, arm_mm, fixed_mm, None, self.record.around)
                )
                self.motion.mark_free()
                return Event.PLACED
        part.hold = None
        await self.record.set_custody(Custody.LOST, key("not in a gripper after the crash"))
        raise PartFaultError(
            PartFault.DROPPED, key("no gripper holds the part any more after the crash")
        )

    async def _open_fixed_wide(self) -> None:
        """Open the fixed gripper, which holds nothing: paths are planned past its open jaws."""
        if (await self.fixed.status()).opening_mm < self.fixed.max_opening_mm - WIDE_MM:
            await self.grippers.open_fixed()
