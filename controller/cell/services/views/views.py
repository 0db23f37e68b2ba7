"""Views of the part: judged in the worker process while the arm moves on."""

import asyncio
import logging
from collections.abc import Mapping

from controller import inspection as inspecting
from controller.arrays import FloatArray, Grey
from controller.cell.compute import Compute
from controller.cell.journal.rows import ViewHold, ViewPicturesTaken
from controller.cell.services.records import (
    BatchRecord,
    PartInGripper,
    Shown,
    matrix,
    merged,
    view_row,
)
from controller.config.view_set import packed
from controller.planning import Look, Present
from controller.planning.model import CellLayout

from .judging import judge_held, judge_on_table

# Of the samples: fewer, on the border of what was shown, are not worth another view.
MIN_NEW_SHARE = 0.001

log = logging.getLogger(__name__)


def plain_name(view: str) -> str:
    """Return a view's name in its plan; from the second plan on it ends in the plan's number."""
    return view.partition("~")[0]


class Views:
    """The views shown to the cameras, and their results.

    Parameters
    ----------
    record : keeps the results with the part
    compute : judges the pictures
    layout : where camera, arm and fixed gripper stand
    """

    def __init__(self, record: BatchRecord, compute: Compute, layout: CellLayout) -> None:
        self._record = record
        self._compute = compute
        self._layout = layout
        self._last_held: Shown | None = None

    @property
    def last_held(self) -> Shown | None:
        """The last view of the held part, judged or not."""
        return self._last_held

    def name(self, step: Present | Look) -> str:
        """Return a view's name; from the second plan on it ends in the number of the plan."""
        plan_count = self._record.part.plan_count
        return step.view_id if plan_count < 2 else f"{step.view_id}~{plan_count}"

    def record_pictures(
        self, step: Present | Look, files: Mapping[str, str], q: FloatArray | None = None
    ) -> None:
        """Journal the pictures of a view, and keep what it is planned to show.

        Parameters
        ----------
        step : that presents it
        files : by lamp
        q : (6,) where the arm stands; None for a part on the table
        """
        view = self.name(step)
        self._record.note(
            ViewPicturesTaken(
                view=view,
                pictures=files,
                q=() if q is None else tuple(q.tolist()),
                hold=None if q is None else _view_hold(self._record.held()),
                planned=packed(step.seen),
                sample_count=len(step.seen),
            )
        )
        self._record.part.planned[view] = step.seen
        self._record.part.files[view] = files

    def judge_held(
        self, view: str, hold: PartInGripper, q: FloatArray, backlit: Grey, lit: Mapping[str, Grey]
    ) -> None:
        """Start judging a view of the held part.

        Parameters
        ----------
        view : its name
        hold : in which it was taken
        q : (6,) where the arm stood
        backlit, lit : pictures before the backlight panel, and by lamp
        """
        self._last_held = judge_held(self._compute, self._layout, view, hold, q, backlit, lit)
        self._record.part.pending.append(self._last_held)

    def judge_on_table(self, view: str, step: Look, backlit: Grey, lit: Mapping[str, Grey]) -> None:
        """Start judging pictures of the table as a view of the part at rest on it.

        Only samples count that the plan has this view resolve.

        Parameters
        ----------
        view : its name
        step : of the plan
        backlit, lit : pictures of the light table, and by lamp
        """
        sighting = self._record.part.sighting
        assert sighting is not None
        T = sighting.T_world_part
        assert T is not None
        shown = judge_on_table(self._compute, view, T, step.seen, backlit, lit)
        self._record.part.pending.append(shown)

    async def take_next(self) -> tuple[Shown, inspecting.ViewResult] | None:
        """Wait for the oldest view still being judged; return it, None if there is none."""
        part = self._record.part
        if not part.pending:
            return None
        shown = part.pending[0]
        result = await asyncio.shield(shown.task)
        part.pending.pop(0)
        self._record.note(view_row(result, part.results))
        part.results.append(result)
        part.judged.append(shown)
        log.info(
            "view %s: %s",
            result.view_id,
            f"{len(result.findings)} findings" if result.evaluated else result.reason,
        )
        return shown, result

    async def is_worth_showing(self, step: Present) -> bool:
        """Return whether a view is planned to show samples that none has shown yet.

        Before the first recovery every view is. After one, this waits for the views still being
        judged.
        """
        part = self._record.part
        if not part.recoveries:
            return True
        tasks = [shown.task for shown in part.pending]
        if tasks:
            await asyncio.wait(tasks)  # a stop cancels this wait, not the tasks
        judged = [t.result() for t in tasks if not t.cancelled() and t.exception() is None]
        in_sight = merged([r.in_sight for r in (*part.results, *judged) if r.evaluated])
        return in_sight is None or float((step.seen & ~in_sight).mean()) >= MIN_NEW_SHARE

    def is_hold_questioned(self) -> bool:
        """Return whether a view judged meanwhile does not confirm how the part is held."""
        pending = self._record.part.pending
        judged = [s.task for s in pending if s.task.done() and not s.task.cancelled()]
        return any(t.exception() is not None or not t.result().evaluated for t in judged)

    def drop_pending(self) -> None:
        """Drop the views that are still being judged."""
        for shown in self._record.part.pending:
            shown.task.cancel()
        self._record.part.pending.clear()


def _view_hold(hold: PartInGripper) -> ViewHold:
    return ViewHold(
        number=hold.number,
        T_part_tcp=matrix(hold.T_part_tcp),
        opening_mm=float(hold.opening_mm),
        is_measured=hold.is_measured,
    )
