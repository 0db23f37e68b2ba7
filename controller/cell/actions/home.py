"""Resetting: power, homing, activation; the planner's long work starts beside it."""

import asyncio

from controller.planning.model import CellLayout
from drivers.kinds import Arm, FixedGripper, IoBlock

from ..errors import PartProblemError
from ..interlocks import check_interlocks
from ..journal import Journal
from ..journal.rows import Homed
from ..machine import Event
from ..services import BatchRecord, Grippers, Imaging, Motion, Preparation


class HomeAction:
    """Makes every device ready and drives the arm to where it is in nobody's way.

    Parameters
    ----------
    arm, gripper, io : devices that have to be powered, homed, activated, healthy
    layout : where the arm is in nobody's way
    motion, grippers, imaging, preparation, record, journal : services
    """

    def __init__(
        self,
        arm: Arm,
        gripper: FixedGripper,
        io: IoBlock,
        layout: CellLayout,
        motion: Motion,
        grippers: Grippers,
        imaging: Imaging,
        preparation: Preparation,
        record: BatchRecord,
        journal: Journal,
    ) -> None:
        self._arm = arm
        self._gripper = gripper
        self._io = io
        self._layout = layout
        self._motion = motion
        self._grippers = grippers
        self._imaging = imaging
        self._preparation = preparation
        self._record = record
        self._journal = journal

    async def run(self) -> Event:
        """Check the interlocks and the fixed gripper, then home both grippers side by side.

        Raises
        ------
        PartProblemError : the fixed gripper holds something
        """
        check_interlocks(self._io)
        self._preparation.begin()
        self._record.show("homing the arm; it sweeps its whole reach")
        await self._imaging.all_dark()
        if await self._grippers.does_fixed_hold():
            raise PartProblemError(
                "fixture_not_empty", "the fixed gripper holds something; take it out first"
            )
        async with asyncio.TaskGroup() as both:
            both.create_task(self._ready_fixed_gripper())
            both.create_task(self._ready_arm())
        self._journal.write(Homed())
        return Event.RESET_DONE

    async def _ready_fixed_gripper(self) -> None:
        await self._gripper.activate()
        await self._grippers.open_fixed()

    async def _ready_arm(self) -> None:
        await self._arm.enable_power()
        if not self._arm.is_homed:
            await self._arm.home()
        await self._grippers.open_arm(self._layout.hand.max_mm * 0.5)
        await self._motion.start_from(self._layout.park_q)
