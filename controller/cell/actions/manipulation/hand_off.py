"""Handing off: the part goes to the fixed gripper and back to the arm gripper, in another grasp.

Each hand-off has two phases: the receiver's opening is confirmed before the giver opens.
"""

from dataclasses import dataclass, replace
from typing import NoReturn

from controller.cell.custody import Custody
from controller.cell.errors import PartFaultError, ReleaseRefusedError
from controller.cell.journal import Once
from controller.cell.machine import GRASP, Event, PartFault, SafePoint
from controller.cell.services import Grippers, Motion, PlanSteps
from controller.cell.services.records import BatchRecord
from controller.imaging import inverse_pose
from controller.planning import GiveStep, ReceiveStep, shown_pose
from controller.planning.model import CellLayout
from messages import key, say


@dataclass(frozen=True, slots=True, eq=False)
class HandOffAction:
    """Changes the grasp by two hand-offs, to the fixed gripper and back.

    Attributes
    ----------
    steps, motion, grippers, record : services
    layout : layout with the pose of the fixed gripper
    """

    steps: PlanSteps
    motion: Motion
    grippers: Grippers
    record: BatchRecord
    layout: CellLayout

    async def run(self) -> Event:
        """Give and receive, or only receive if the fixed gripper has it; return ``HANDED_OFF``.

        Raises
        ------
        PartFaultError : the part is lost, or the receiver did not get it
        """
        give = self.steps.next(GiveStep)
        if give is not None:
            await self._give(give)
        receive = self.steps.next(ReceiveStep)
        if receive is not None:
            await self._receive(receive)
        return Event.HANDED_OFF

    async def _give(self, step: GiveStep) -> None:
        started_s, record = self.steps.begin(step), self.record
        await self.grippers.open_fixed(step.fixed_pre_open_mm)
        await self.motion.follow(step.motion)
        await self.grippers.press_and_require_hold()
        fixed_mm = await self._close_fixed(step)
        await record.set_custody(Custody.IN_BOTH)
        if not await self.grippers.does_fixed_hold():
            await self._keep_in_arm(step, key("the fixed gripper lost the part at once"))
        hold = record.held()
        T_world_part = shown_pose(self.layout, await self.motion.read_q(), hold.T_part_tcp)
        fixed_grasp = replace(
            step.fixed_grasp,
            T_part_tcp=inverse_pose(T_world_part) @ self.layout.T_world_fixed_tcp,
        )
        record.note_fixed_grasp(fixed_grasp, fixed_mm)
        try:
            await self.grippers.release_to_fixed(step.arm_open_mm, step.retreat)
        except ReleaseRefusedError as error:  # it let go since it was read
            await self._keep_in_arm(step, str(error))
        record.part.fixed_grasp = fixed_grasp
        await record.set_custody(Custody.IN_FIXED)
        await self.grippers.require_fixed_holds()
        await self.motion.follow(step.retreat)
        self.steps.end(step, started_s)

    async def _close_fixed(self, step: GiveStep) -> float:
        """Close the fixed gripper on the part; return the opening reached [mm]."""
        expected_mm = step.fixed_expected_opening_mm
        result = await self.grippers.close_fixed(expected_mm, step.fixed_pre_open_mm)
        beyond_mm = self.grippers.beyond_mm(result.opening_mm, expected_mm)
        if not result.object_detected or beyond_mm:
            await self._keep_in_arm(
                step,
                say(
                    "the fixed gripper closed to {opening_mm:.1f} mm, "
                    "{expected_mm:.1f} mm was expected",
                    opening_mm=result.opening_mm,
                    expected_mm=expected_mm,
                ),
            )
        return result.opening_mm

    async def _keep_in_arm(self, step: GiveStep, why: str) -> NoReturn:
        """Keep the part in the arm gripper and go back to the start of the step."""
        hold = self.record.held()
        await self.record.set_custody(
            Custody.IN_ARM, key("the fixed gripper did not receive the part")
        )
        # no wider than on the way in: the arm's fingers are between its own
        await self.grippers.open_fixed(step.fixed_pre_open_mm)
        await self.grippers.press_and_require_hold()
        # the fixed gripper may have turned the part by closing on the wrong faces
        hold.is_measured = False
        self.record.note_hold()
        await self.motion.go_back(len(step.motion))
        await self.grippers.open_fixed()
        self.motion.reach(SafePoint.LIFTED, ends_step=True)
        raise PartFaultError(
            PartFault.HAND_OFF_FAILED,
            say("hand-off: {why}; the arm gripper still holds the part", why=why),
            source=GRASP + step.fixed_grasp.id,
        )

    async def _receive(self, step: ReceiveStep) -> None:
        started_s, record = self.steps.begin(step), self.record
        await self.motion.follow(step.motion_in)
        await self.grippers.open_arm(step.pre_open_mm)
        await self.motion.follow(step.approach)
        await self.grippers.require_fixed_holds()
        record.expect_hold(step.grasp)
        opening_mm = await self.grippers.close_arm(Once.RECEIVE, step.expected_opening_mm)
        if self.grippers.beyond_mm(opening_mm, step.expected_opening_mm):
            await self._leave_in_fixed(step, opening_mm)
        record.take_hold(step.grasp, opening_mm)
        await record.set_custody(Custody.IN_BOTH)
        try:
            await self.grippers.release_to_arm(step.fixed_open_mm, step.motion_out)
        except ReleaseRefusedError:
            await self.grippers.press_and_require_hold()  # raises what is wrong with the grasp
            raise
        await record.set_custody(
            Custody.IN_ARM, say("jaws at {opening_mm:.1f} mm", opening_mm=opening_mm)
        )
        await self.grippers.press_and_require_hold()
        await self.motion.follow(step.motion_out)
        # paths after this one are planned past an empty fixed gripper that stands wide open
        await self.grippers.open_fixed()
        await self.grippers.press_and_require_hold()
        self.steps.end(
            step, started_s, jaw_mm=round(opening_mm, 2), expected_mm=step.expected_opening_mm
        )

    async def _leave_in_fixed(self, step: ReceiveStep, opening_mm: float) -> NoReturn:
        """Leave the part in the fixed gripper and go back to the start of the step."""
        await self.grippers.open_arm(step.pre_open_mm)
        await self.record.set_custody(
            Custody.IN_FIXED, key("the arm gripper did not receive the part")
        )
        await self.motion.go_back(len(step.approach))
        await self.grippers.require_fixed_holds()
        await self.motion.go_back(len(step.motion_in))
        self.motion.reach(SafePoint.IN_FIXED, ends_step=True)
        raise PartFaultError(
            PartFault.RECEIVE_FAILED,
            say(
                "hand-off back: the arm gripper's jaws stopped at {opening_mm:.1f} "
                "mm, {expected_opening_mm:.1f} mm was expected; the fixed gripper "
                "still holds it",
                opening_mm=opening_mm,
                expected_opening_mm=step.expected_opening_mm,
            ),
            source=GRASP + step.grasp.id,
        )
