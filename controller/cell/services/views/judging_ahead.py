"""The current part, judged ahead: a finished grasp's views are judged while the arm goes on.

The pose of the part in the jaws follows from all views of a grasp together, and the comparison of
each view from that pose. Once the arm changes the grasp, nothing of it changes any more (ADR 81).
"""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from controller.cell.compute import Compute, OneTask
from controller.cell.services.records import BatchProduct, BatchRecord, PartRecord, Shown
from controller.planning import Look, Present

from .judging import Background
from .part_file import PartFileWriter

log = logging.getLogger(__name__)

JudgeAhead = Callable[[Path, str, int], Coroutine[Any, Any, bool]]


@dataclass(slots=True, eq=False)
class JudgingAhead:
    """Has the worker process judge the views of finished grasps, piece by piece.

    Work that is unfinished when the part is judged is done then: only the duration depends on it.

    Attributes
    ----------
    record : has the part
    compute : judges
    background : asks it
    part_file : writes what the part will be judged from
    """

    record: BatchRecord
    compute: Compute
    background: Background
    part_file: PartFileWriter
    _work_at_hand: OneTask[None] = field(default_factory=OneTask, init=False)

    def begin(self) -> None:
        """Begin with all views shown so far; returns at once."""
        self.drop()
        part, product = self.record.part, self.record.product
        if shown := part.shown:
            work = self._work(part, product, shown, self.compute.judge_ahead)
            self._work_at_hand.begin(work)

    def drop(self) -> None:
        """Go on with it no more."""
        self._work_at_hand.drop()

    async def aclose(self) -> None:
        """Drop the work, and wait until none of it runs in this process."""
        await self._work_at_hand.aclose()

    async def _work(
        self,
        part: PartRecord,
        product: BatchProduct,
        shown: Sequence[Shown],
        judge_ahead: JudgeAhead,
    ) -> None:
        try:
            text = await asyncio.to_thread(self.part_file.text, part, product, shown)
            path, count = self.part_file.path(part), _view_count(part)
            async with self.background.lane:
                while await judge_ahead(path, text, count):
                    pass
        except Exception as error:  # noqa: BLE001  whatever it is: the part is judged as ever
            log.warning("part %d is not judged ahead: %s", part.number, error)


def _view_count(part: PartRecord) -> int:
    """Return the number of views of the part, if its plan is followed to the end."""
    left = () if part.plan is None else part.plan.steps[part.next_step :]
    coming = sum(isinstance(step, Present | Look) for step in left)
    return len(part.judged) + len(part.pending) + coming
