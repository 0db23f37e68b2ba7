"""Recognising: the next part on the table, its stable pose and its place."""

from dataclasses import dataclass

import numpy as np

from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.devices.lamps import TABLE_LAMPS, TABLE_PANEL
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.machine import Event, PartFault
from controller.cell.services import Codes
from controller.cell.services.records import BatchRecord
from controller.cell.services.table import Taking


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
            await self.record.set_custody(Custody.ON_TABLE, "found again")
        await self.codes.read_on_table(lit)
        s = part.sighting
        assert s is not None
        beside = f"; {len(part.neighbours)} others are left alone" if part.neighbours else ""
        self.record.show(
            "recognised",
            part_pose=f"{s.part}, pose {s.pose_index}, x {s.x_mm:.1f} y {s.y_mm:.1f} mm, "
            f"{np.degrees(s.theta_rad):.1f} deg{beside}",
        )
        return Event.PART_RECOGNISED

    def _nothing_found(self) -> PartProblemError:
        part = self.record.part
        if part.custody is Custody.ON_TABLE:
            return PartProblemError(
                "no_part", "no part on the table: lay one on the backlit area and start again"
            )
        lost = next(r for r in reversed(part.recoveries) if r.fault is not PartFault.NOT_SEEN)
        return PartFaultError(
            PartFault.NOT_SEEN,
            f"{lost.reason}; the camera over the table does not see it: look "
            + (
                "below the arm's last path and at the fixed gripper"
                if part.custody is Custody.LOST
                else "in the arm gripper"
            ),
            code=lost.fault.value,
        )
