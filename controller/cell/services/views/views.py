"""Views of the part: judged in the worker process while the arm moves on.

Each view has two results. The part's pose is known soon, and is all that the next motion may depend
on. The comparison takes some ten times as long, and is collected when it is ready, or with the
verdict of the part, whichever is sooner.
"""

import asyncio
import logging
from collections.abc import Mapping, Sequence

from controller import inspection as inspecting
from controller.arrays import FloatArray, Grey
from controller.cell.compute import Compute, Located
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

from .judging import Background, judge_held, judge_on_table

# Share of the samples below which a further view is not worth it; fewer, on the border of the
# surface shown, do not count.
MIN_NEW_SHARE = 0.001
FAIL_COUNT = 2  # looks that a failure takes (inspection, ADR 17)

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
    background : queue for questions that do not hold up the arm
    layout : layout with camera, arm and fixed gripper
    """

    def __init__(
        self, record: BatchRecord, compute: Compute, background: Background, layout: CellLayout
    ) -> None:
        self._record = record
        self._compute = compute
        self._background = background
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
        """Journal the pictures of a view, and keep the samples it is planned to show.

        Parameters
        ----------
        step : step that presents it
        files : by lamp
        q : (6,) joints of the arm; None for a part on the table
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
    ) -> Shown:
        """Start judging a view of the held part; return it.

        Parameters
        ----------
        view : its name
        hold : grasp in which it was taken
        q : (6,) joints of the arm
        backlit, lit : pictures before the backlight panel, and by lamp
        """
        shown = judge_held(
            self._compute,
            self._background,
            self._layout,
            view,
            hold,
            q,
            backlit,
            lit,
            facts=self._record.part.facts,
        )
        self._last_held = shown
        self._keep(shown)
        return shown

    def judge_on_table(self, view: str, step: Look, backlit: Grey, lit: Mapping[str, Grey]) -> None:
        """Start judging pictures of the table as a view of the part at rest on it.

        Only samples count that the plan has this view resolve.

        Parameters
        ----------
        view : its name
        step : step of the plan
        backlit, lit : pictures of the light table, and by lamp
        """
        sighting = self._record.part.sighting
        assert sighting is not None
        T = sighting.T_world_part
        assert T is not None
        facts = self._record.part.facts
        self._keep(
            judge_on_table(self._compute, self._background, view, T, step.seen, backlit, lit, facts)
        )

    def _keep(self, shown: Shown) -> None:
        self._record.part.pending.append(shown)
        self._record.part.unlearned.append(shown)

    async def learn_next(self) -> tuple[Shown, Located] | None:
        """Wait for the part's pose in the oldest view; return the view, else None.

        Each view is returned once. A view of the table is skipped until its result is ready.
        """
        part = self._record.part
        known = (s for s in part.unlearned if s.located is not None or s.task.done())
        shown = next(known, None)
        if shown is None:
            return None
        if shown.located is not None:
            found = await asyncio.shield(shown.located)
        else:
            result = await asyncio.shield(shown.task)
            found = Located(result.evaluated, result.reason, result.T_world_part_known)
        part.unlearned.remove(shown)
        return shown, found

    async def take_next(self) -> tuple[Shown, inspecting.ViewResult] | None:
        """Wait for the oldest view still being judged; return it, None if there is none."""
        part = self._record.part
        if not part.pending:
            return None
        shown = part.pending[0]
        result = await asyncio.shield(shown.task)
        if part.pending and part.pending[0] is shown:  # nobody has taken it meanwhile
            self._take(shown, result)
        return shown, result

    async def take_all(self) -> None:
        """Wait for all views still being judged, and take them; their poses are not asked for."""
        while await self.take_next() is not None:
            pass
        self._record.part.unlearned.clear()

    def take_ready(self) -> None:
        """Take the finished views, in the order they were shown."""
        pending = self._record.part.pending
        while pending and (task := pending[0].task).done():
            if task.cancelled() or task.exception() is not None:
                return  # raised to whoever waits for it
            self._take(pending[0], task.result())

    def take_judged(self, results: Sequence[inspecting.ViewResult]) -> None:
        """Take all views from a judgement of the part; those without a result need none any more.

        Parameters
        ----------
        results : of all views shown
        """
        self.take_ready()
        by_id = {result.view_id: result for result in results}
        for shown in tuple(self._record.part.pending):
            shown.task.cancel()
            self._take(shown, by_id[shown.view])
        self._record.part.unlearned.clear()

    def _take(self, shown: Shown, result: inspecting.ViewResult) -> None:
        part = self._record.part
        part.pending.pop(0)
        self._record.note(view_row(result, part.results))
        part.results.append(result)
        part.judged.append(shown)
        log.info(
            "view %s: %s",
            result.view_id,
            f"{len(result.findings)} findings" if result.evaluated else result.reason,
        )

    async def is_worth_showing(self, step: Present) -> bool:
        """Return whether a view is planned to show samples that none has shown yet.

        Before the first recovery every view is needed, and so is one for faces that could be
        compared too little from another grasp. After a recovery, this waits for the views still
        being judged.
        """
        part = self._record.part
        if not part.recoveries or part.short:
            return True
        tasks = [shown.task for shown in part.pending]
        if tasks:
            await asyncio.wait(tasks)  # a stop cancels this wait, not the tasks
        judged = [t.result() for t in tasks if not t.cancelled() and t.exception() is None]
        in_sight = merged([r.in_sight for r in (*part.results, *judged) if r.evaluated])
        return in_sight is None or float((step.seen & ~in_sight).mean()) >= MIN_NEW_SHARE

    def is_hold_questioned(self) -> bool:
        """Return whether a finished view fails to confirm the hold of the part."""
        tasks = [s.located for s in self._record.part.unlearned if s.located is not None]
        known = [t for t in tasks if t.done() and not t.cancelled()]
        return any(t.exception() is not None or not t.result().evaluated for t in known)

    def may_have_failed(self) -> bool:
        """Return whether the part is to be judged before its last view (`stop_at_fail`).

        A failure takes two looks, and nothing is judged twice: that calls for two views with
        findings, one of them new.
        """
        part, wanted = self._record.part, self._record.product.recipe.inspection
        return wanted.stop_at_fail and part.suspects >= max(FAIL_COUNT, part.suspect_count + 1)

    def drop_pending(self) -> None:
        """Drop the views that are still being judged."""
        part = self._record.part
        for shown in (*part.pending, *part.unlearned):
            shown.task.cancel()
            if shown.located is not None:
                shown.located.cancel()
        for task in part.reading:
            task.cancel()
        part.reading.clear()
        part.pending.clear()
        part.unlearned.clear()


def _view_hold(hold: PartInGripper) -> ViewHold:
    return ViewHold(
        number=hold.number,
        T_part_tcp=matrix(hold.T_part_tcp),
        opening_mm=float(hold.opening_mm),
        is_measured=hold.is_measured,
    )
