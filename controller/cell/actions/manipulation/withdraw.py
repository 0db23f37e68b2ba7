"""Withdrawing: the arm leaves the overhead camera's view of the table."""

from contextlib import suppress
from dataclasses import dataclass

from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.errors import PartProblemError
from controller.cell.machine import Event, SafePoint
from controller.cell.services import Grippers, Motion, Recoveries
from controller.cell.services.records import BatchRecord
from controller.planning import NoMotionError
from messages import key


@dataclass(frozen=True, slots=True, eq=False)
class WithdrawAction:
    """Parks the arm, from any place.

    Attributes
    ----------
    compute : finds a path
    motion, grippers, recoveries, record : services
    """

    compute: Compute
    motion: Motion
    grippers: Grippers
    recoveries: Recoveries
    record: BatchRecord

    async def run(self) -> Event:
        """Go back along the arm's own path until homing is possible; return ``WITHDRAWN``.

        Where a person took the last part out, return ``BATCH_DONE``.

        Raises
        ------
        PartProblemError : there is no such path, or a lost part hangs in the fixed gripper
        """
        self.record.show(key("taking the arm out of the way"))
        self.recoveries.forget_drop()
        part = self.record.part
        self.motion.reach(SafePoint.STANDING, ends_step=True)
        if part.is_said_to_be_out:
            await self._book_removal()
        T_part_tcp = part.hold.T_part_tcp if part.hold is not None else None
        while True:
            arm_mm, fixed_mm = await self.grippers.openings_mm()
            q = await self.motion.read_q()
            with suppress(NoMotionError):
                path = await self.compute.path_home(
                    q, arm_mm, fixed_mm, T_part_tcp, self.record.around
                )
                break
            if not self.motion.can_go_back:
                raise PartProblemError(
                    "no_way_home",
                    key(
                        "no path free of contact leads the arm out of the camera's sight; "
                        "clear the space about it and start again"
                    ),
                )
            await self.motion.go_back(1)
            self.motion.reach(SafePoint.STANDING, ends_step=True)
        await self.motion.follow(path)
        self.motion.mark_free()
        if part.custody is Custody.LOST:
            if self.grippers.is_something_in_fixed:
                raise PartProblemError(
                    "part_lost", key("the part hangs loosely in the fixed gripper; take it out")
                )
            await self.grippers.open_fixed()
        self.motion.reach(SafePoint.PARKED, ends_step=True)
        if self.record.parts_left == 0:
            return Event.BATCH_DONE
        return Event.WITHDRAWN

    async def _book_removal(self) -> None:
        """Count a part as done that a person took out, once both grippers are found empty."""
        part = self.record.part
        part.is_said_to_be_out = False
        if part.custody is not Custody.ON_TABLE:
            await self.grippers.require_empty()
        part.hold, part.fixed_grasp = None, None
        await self.record.set_custody(Custody.REMOVED, key("both grippers are empty"))
        self.record.finish_part()
