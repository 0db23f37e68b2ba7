"""Recognising: the next part on the table, its stable pose and its place."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.devices.lamps import TABLE_LAMPS, TABLE_PANEL
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.machine import Event, PartFault
from controller.cell.services import Codes
from controller.cell.services.records import BatchRecord
from controller.cell.services.table import Taking
from messages import key, say

LOST: Final = key(
    "{reason}; the camera over the table does not see it: look below the arm's last path and at "
    "the fixed gripper"
)
UNSEEN: Final = key("{reason}; the camera over the table does not see it: look in the arm gripper")


@dataclass(frozen=True, slots=True, eq=False)
class RecogniseAction:
    """Finds a part of the batch on the table; other objects are left alone.

    Attributes
    ----------
    compute : recognises, in the worker process
    taking : service that chooses the object to take
    record : record of the batch; gets what was recognised
    codes : reads the serial number off the part taken, where a code has it
    """

    compute: Compute
    taking: Taking
    record: BatchRecord
    codes: Codes

    async def run(self) -> Event:
        """Recognise the objects in the pictures of the table; return ``PART_RECOGNISED``.

        Raises
        ------
        PartFaultError : the part was lost, and nothing else than before is on the table
        PartProblemError : nothing is there, or nothing that can be taken for the part, or nobody
            reads the number that its code does not tell
        """
        self.record.show("recognising")
        part = self.record.part
        lit = {lamp: part.pictures[lamp] for lamp in TABLE_LAMPS}
        sightings = await self.compute.recognise(part.pictures[TABLE_PANEL], lit)
        if not await self.taking.take(sightings):
            raise self._nothing_found()
        if part.custody is not Custody.ON_TABLE:
            part.hold = None
            await self.record.set_custody(Custody.ON_TABLE, key("found again"))
        await self.codes.read_on_table(lit)
        s = part.sighting
        assert s is not None
        beside = (
            say("; {neighbours_count} others are left alone", neighbours_count=len(part.neighbours))
            if part.neighbours
            else ""
        )
        turned = say("{degrees:.1f} deg", degrees=np.degrees(s.theta_rad))
        turn: str = turned
        if s.is_turn_free:
            turn = key("turn not seen")
        elif s.is_roll_free:
            turn = say("{turned}, roll not seen", turned=turned)
        self.record.show(
            "recognised",
            part_pose=say(
                "{part}, pose {pose_index}, x {x_mm:.1f} y {y_mm:.1f} mm, {turn}{beside}",
                part=s.part,
                pose_index=s.pose_index,
                x_mm=s.x_mm,
                y_mm=s.y_mm,
                turn=turn,
                beside=beside,
            ),
        )
        return Event.PART_RECOGNISED

    def _nothing_found(self) -> PartProblemError:
        part = self.record.part
        if part.custody is Custody.ON_TABLE:
            return PartProblemError(
                "no_part", key("no part on the table: lay one on the backlit area and start again")
            )
        lost = next(r for r in reversed(part.recoveries) if r.fault is not PartFault.NOT_SEEN)
        return PartFaultError(
            PartFault.NOT_SEEN,
            say(LOST if part.custody is Custody.LOST else UNSEEN, reason=lost.reason),
            code=lost.fault.value,
        )
