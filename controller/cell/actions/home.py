"""Resetting: power, homing, activation; the planner's long work starts beside it."""

import asyncio
from dataclasses import dataclass

from controller.cell.compute import Compute
from controller.cell.custody.openings import Occupancy
from controller.cell.devices.interlocks import check_interlocks
from controller.cell.errors import PartProblemError
from controller.cell.journal import Journal
from controller.cell.journal.rows import Homed, PositionsTakenOver
from controller.cell.machine import Event, SafePoint
from controller.planning import NoMotionError
from controller.planning.model import CellLayout
from drivers.kinds import IoBlock
from messages import key, say

from ..services import Gate, Grippers, Imaging, Motion, Preparation, Resumption
from ..services.motion import rounded
from ..services.records import BatchRecord


async def _until_healthy(io: IoBlock, gate: Gate, motion: Motion) -> None:
    async def check() -> None:
        check_interlocks(io)

    await gate.until_admitted(check, motion.homing_preview)


@dataclass(frozen=True, slots=True, eq=False)
class HomeAction:
    """Makes every device ready and moves the arm out of the way of cameras and grippers.

    Attributes
    ----------
    io : the interlocks, which have to be healthy
    layout : layout with the configuration to park in, and the widest opening of the arm gripper
    compute : finds a path to park
    motion, grippers, imaging, preparation, record, journal, gate : services
    """

    io: IoBlock
    layout: CellLayout
    compute: Compute
    motion: Motion
    grippers: Grippers
    imaging: Imaging
    preparation: Preparation
    record: BatchRecord
    journal: Journal
    gate: Gate

    async def run(self) -> Event:
        """Check interlocks and fixed gripper, home both grippers at once; return ``RESET_DONE``.

        Raises
        ------
        InterlockError : a safety copy is not healthy; an open door is waited for
        PartProblemError : the fixed gripper holds something, or no path free of contact leads an
            arm of absolute encoders from where it stands to its park position
        """
        await _until_healthy(self.io, self.gate, self.motion)
        self.preparation.begin()
        self.record.show(self.motion.homing_words)
        await self.imaging.all_dark()
        found = await self.grippers.read_fixed()
        if found.occupancy is Occupancy.HOLDS:
            raise PartProblemError(
                "fixture_not_empty",
                say(
                    "the fixed gripper holds something: {reason}; take that out first",
                    reason=found.reason,
                ),
            )
        async with asyncio.TaskGroup() as both:
            both.create_task(self._ready_fixed_gripper())
            both.create_task(self._ready_arm())
        if not self.motion.sweeps_to_home:
            await self._park_from_anywhere()
        self.journal.write(Homed())
        return Event.RESET_DONE

    async def _ready_fixed_gripper(self) -> None:
        await self.grippers.activate_fixed()
        await self.grippers.open_fixed()

    async def _ready_arm(self) -> None:
        await self.motion.home()
        await self.grippers.open_arm(self.layout.arm_gripper.max_mm * 0.5)
        if self.motion.sweeps_to_home:
            await self.motion.start_from(self.layout.park_q)  # from where homing ends

    async def _park_from_anywhere(self) -> None:
        q = await self.motion.read_q()
        openings_mm = await self.grippers.openings_mm()
        try:
            path = await self.compute.path_home(q, *openings_mm, None, self.record.around)
        except NoMotionError as error:
            raise PartProblemError(
                "no_way_home",
                say(
                    "no path free of contact leads the arm from where it stands to its "
                    "park position: {error}; move it clear with `cellctl jog` or its "
                    "pendant, and start again",
                    error=error,
                ),
            ) from error
        await self.motion.follow(path)
        self.motion.mark_free()
        self.motion.reach(SafePoint.PARKED, ends_step=True)


@dataclass(frozen=True, slots=True, eq=False)
class ReadyAction:
    """Makes the cell ready without moving anything: a gripper may hold a part.

    Attributes
    ----------
    io : the interlocks, which have to be healthy
    resumption : whether the arm still has to home, with a part
    motion, imaging, preparation, record, journal, gate : services
    """

    io: IoBlock
    resumption: Resumption
    motion: Motion
    imaging: Imaging
    preparation: Preparation
    record: BatchRecord
    journal: Journal
    gate: Gate

    async def run(self) -> Event:
        """Check interlocks, give the arm power; return ``RESET_DONE``. Opens no jaw, homes nothing.

        Raises
        ------
        InterlockError : a safety copy is not healthy; an open door is waited for
        """
        await _until_healthy(self.io, self.gate, self.motion)
        self.preparation.begin()
        self.record.show(key("getting ready; nothing is homed, because a gripper may hold a part"))
        await self.imaging.all_dark()
        if self.resumption.homes:
            return Event.RESET_DONE  # power comes once the part has been taken over
        await self.motion.enable_power()
        (q,) = rounded([await self.motion.read_q()])
        self.journal.write(PositionsTakenOver(q=q))
        return Event.RESET_DONE


@dataclass(frozen=True, slots=True, eq=False)
class ResetAction:
    """Homes the cell, or only makes it ready if the part of an interrupted run is continued.

    Attributes
    ----------
    home, ready : the two ways
    resumption : resumption, which decides between them
    """

    home: HomeAction
    ready: ReadyAction
    resumption: Resumption

    async def run(self) -> Event:
        """Return ``RESET_DONE``; raises as the action that it runs."""
        if self.resumption.accepted is not None:
            return await self.ready.run()
        return await self.home.run()
