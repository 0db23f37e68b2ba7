"""Completing: the part is counted as done; the next one follows, or the batch ends."""

from dataclasses import dataclass

from controller.cell.journal.rows import PartDone
from controller.cell.machine import Event

from ..services import Imaging
from ..services.records import BatchRecord


@dataclass(frozen=True, slots=True, eq=False)
class CompleteAction:
    """Counts the part as done.

    Attributes
    ----------
    record : the part and the batch
    imaging : its lamps are switched off at the end
    """

    record: BatchRecord
    imaging: Imaging

    async def run(self) -> Event:
        """Count the part, at the end switch lamps off; return ``PART_DONE`` or ``BATCH_DONE``."""
        part = self.record.part
        assert part.verdict is not None
        await self.record.note_secured(
            PartDone(
                verdict=part.verdict.verdict.value,
                tray=part.tray,
                recoveries=tuple(one.fault.value for one in part.recoveries),
            )
        )
        self.record.finish_part()
        if self.record.parts_left > 0:
            return Event.PART_DONE
        await self.imaging.all_dark()
        return Event.BATCH_DONE
