"""Resetting: power, homing, activation; the planner's long work starts beside it."""

import asyncio
from dataclasses import dataclass

from controller.cell.devices.interlocks import check_interlocks
from controller.cell.errors import PartProblemError
from controller.cell.journal import Journal
from controller.cell.journal.rows import Homed
from controller.cell.machine import Event
from controller.planning.model import CellLayout
from drivers.kinds import IoBlock

from ..services import Grippers, Imaging, Motion, Preparation
from ..services.records import BatchRecord


@dataclass(frozen=True, slots=True, eq=False)
class HomeAction:
    """Makes every device ready and moves the arm out of the way of cameras and grippers.

    Attributes
    ----------
    io : the interlocks, which have to be healthy
    layout : has the configuration to park in, and how wide the arm gripper opens
    motion, grippers, imaging, preparation, record, journal : services
    """

    io: IoBlock
    layout: CellLayout
    motion: Motion
    grippers: Grippers
    imaging: Imaging
    preparation: Preparation
    record: BatchRecord
    journal: Journal

    async def run(self) -> Event:
        """Check interlocks and fixed gripper, home both grippers at once; return ``RESET_DONE``.

        Raises
        ------
        PartProblemError : the fixed gripper holds something
        """
        check_interlocks(self.io)
        self.preparation.begin()
        self.record.show("homing the arm; it sweeps its whole reach")
        await self.imaging.all_dark()
        if await self.grippers.does_fixed_hold():
            raise PartProblemError(
                "fixture_not_empty", "the fixed gripper holds something; take it out first"
            )
        async with asyncio.TaskGroup() as both:
            both.create_task(self._ready_fixed_gripper())
            both.create_task(self._ready_arm())
        self.journal.write(Homed())
        return Event.RESET_DONE

    async def _ready_fixed_gripper(self) -> None:
        await self.grippers.activate_fixed()
        await self.grippers.open_fixed()

    async def _ready_arm(self) -> None:
        await self.motion.home()
        await self.grippers.open_arm(self.layout.arm_gripper.max_mm * 0.5)
        await self.motion.start_from(self.layout.park_q)
