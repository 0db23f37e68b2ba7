"""Completing: the part is booked; the next one follows, or the batch ends."""

from ..journal.rows import PartDone
from ..machine import Event
from ..services import BatchRecord, Imaging


class CompleteAction:
    """Counts the part among those done."""

    def __init__(self, record: BatchRecord, imaging: Imaging) -> None:
        self._record = record
        self._imaging = imaging

    async def run(self) -> Event:
        """Book the part; switch the lamps off after the last one."""
        self._record.finish_part()
        part = self._record.part
        assert part.verdict is not None
        self._record.note(
            PartDone(
                verdict=part.verdict.verdict.value,
                tray=part.tray,
                recoveries=tuple(one.fault.value for one in part.recoveries),
            )
        )
        if self._record.parts_left > 0:
            return Event.PART_DONE
        await self._imaging.all_dark()
        return Event.BATCH_DONE
