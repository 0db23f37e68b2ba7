"""Actions that show the part to a camera, and what is learnt from its pictures."""

import asyncio
import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.imaging import inverse_pose
from controller.planning import Doubt, HandOver, Look, Present, SetDown, TakeBack, shown_pose
from controller.planning.motion import tip_pose

from . import workers
from .custody import Custody
from .errors import PartProblemError, PartTroubleError
from .handling import Handling
from .holder import holder_boxes
from .machine import Event
from .records import Hold, Shown, describe_verdict, describe_view
from .recovery import WORTH_SHARE, Trouble, is_held_otherwise, merged

log = logging.getLogger(__name__)

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

DOUBTS_N = 2  # bad views in a row after which a hold that was seen is no longer believed
SETTLE_S = 0.3  # a long arm rings after it stops


class Showing(Handling):
    """What the cameras are shown of the part, and what inspection makes of it."""

    async def grasp(self) -> Event:
        """Judge the part where it lies, if the plan says so, while the hand comes and takes it."""
        while (look := self._step(Look)) is not None:
            started = self._begin(look)
            self._look_at_table(look)
            self._end(look, started, view=self._name(look))
        return await super().grasp()

    async def present(self) -> Event:
        """Show views to the inspection camera until something must be judged first.

        After each new grip one view is judged before the next: the hold is verified by sight. In
        a plan made after a recovery, a view that would show nothing new is passed by.
        """
        camera = self._devices.inspection
        try:
            while (step := self._step(Present)) is not None:
                started = self._begin(step)
                await self._move(step.motion)
                await self._require_held()
                hold = self._held()
                if hold.is_seen and not await self._is_worth(step):
                    self._end(step, started, passed_by=step.view_id)
                    continue
                await self._look(step, hold)
                self._end(step, started, view=self._name(step))
                if not hold.is_seen or self._is_in_doubt():
                    return Event.SHOWN
        finally:
            await camera.pause()
        return Event.SHOWN

    def _look_at_table(self, step: Look) -> None:
        """Hand the pictures that were just taken of the table to the worker, as a view."""
        part = self.part
        assert part.sighting is not None
        T = part.sighting.T_world_part
        assert T is not None
        glowing = part.pictures["table_backlight"]
        # what stands about the table throws shadows by the side lamp that no prediction knows of
        lit = {lamp: part.pictures[lamp] for lamp in workers.TABLE_LAMPS[:1]}
        view = self._name(step)
        self._journal.record(
            "observation",
            "view_pictures",
            {"view": view, "pictures": part.picture_names, "q": []},
            part.number,
        )
        part.planned[view] = step.seen
        task = asyncio.ensure_future(self._counted(view, T, glowing, lit, step))
        part.pending.append(Shown(view, None, np.zeros(6), T, (), glowing, task))

    async def _counted(
        self, view: str, T: Array, glowing: Grey, lit: Mapping[str, Grey], step: Look
    ) -> inspecting.ViewResult:
        """Judge a view of the lying part; it counts for what the plan says it resolves."""
        result = await self._experts.inspect_lying(view, T, glowing, lit)
        return result.within(step.seen)

    def _name(self, step: Present | Look) -> str:
        """Return what a view is called: plans after the first one begin to count anew."""
        plan = self.part.plan_count
        return step.view_id if plan < 2 else f"{step.view_id}~{plan}"

    async def _is_worth(self, step: Present) -> bool:
        """Tell whether a view was meant to show what none has truly shown yet.

        Without a recovery before, the plan is driven as it is. After one, the views still being
        judged are waited for.
        """
        if not self.part.recoveries:
            return True
        tasks = [shown.task for shown in self.part.pending]
        if tasks:
            await asyncio.wait(tasks)  # which, cancelled, leaves them be: what they tell are facts
        judged = [t.result() for t in tasks if not t.cancelled() and t.exception() is None]
        seen = merged([r.shown for r in (*self.part.results, *judged) if r.evaluated])
        return seen is None or bool((step.seen & ~seen).any())

    def _is_in_doubt(self) -> bool:
        """Tell whether a view judged meanwhile says that the part is not where it should be."""
        judged = [s.task for s in self.part.pending if s.task.done() and not s.task.cancelled()]
        return any(t.exception() is not None or not t.result().evaluated for t in judged)

    async def _look(self, step: Present, hold: Hold) -> None:
        """Take the pictures of a view and hand them to the worker, which judges them meanwhile."""
        await self._clock.sleep(SETTLE_S)
        view, lamps = self._name(step), _lamps_for(step)
        backlit = await self._shoot("inspection", {"station_backlight": 1.0})
        lit = {lamp: await self._shoot("inspection", {lamp: 1.0}) for lamp in lamps}
        q = await self._devices.arm.read_q()
        names = {
            lamp: await self._save(f"{view}_{lamp}", image)
            for lamp, image in {"station_backlight": backlit, **lit}.items()
        }
        self._journal.record(
            "observation",
            "view_pictures",
            {"view": view, "pictures": names, "q": q.tolist()},
            self.part.number,
        )
        self.part.planned[view] = step.seen
        if step.doubt is not None:
            await self._settle(step.doubt, hold, q, backlit, tuple(lit.values()))
        expected = shown_pose(self._layout, q, hold.T_part_hand)
        holder = holder_boxes(self._layout, q, hold.width_mm)
        task = asyncio.ensure_future(
            self._experts.inspect(view, expected, holder, backlit, lit, hold.is_seen)
        )
        self._last_shown = Shown(view, hold, q, expected, holder, backlit, task)
        self.part.pending.append(self._last_shown)

    async def _settle(
        self, doubt: Doubt, hold: Hold, q: Array, backlit: Grey, lit: tuple[Grey, ...]
    ) -> None:
        """Find out by the view that tells what is in the hand.

        Raises
        ------
        PartTroubleError : the part, but it lies another way than was planned with
        PartProblemError : another part, or the doubt stays
        """
        part, names = self.part, [c.name for c in doubt.candidates]
        left = await self._experts.tell(doubt, q, hold.width_mm, backlit, lit)
        part.candidates = ()
        self._journal.record(
            "decision",
            "doubt_settled",
            {"between": names, "left": [names[k] for k in left], "light": doubt.light},
            part.number,
        )
        if left == (0,):
            return
        if not left:
            raise PartProblemError(
                "unknown_object", f"what is in the hand looks like none of {', '.join(names)}"
            )
        if len(left) > 1:
            raise PartProblemError(
                "ambiguous",
                f"it may still be {' or '.join(names[k] for k in left)}; look at what the hand "
                "holds",
            )
        found = doubt.candidates[left[0]]
        if found.name != names[0]:
            raise PartProblemError(
                "wrong_part", f"the view tells: it is {found.name}, the recipe is for {names[0]}"
            )
        hold.T_part_hand = inverse_pose(found.T_hand_part)
        raise PartTroubleError(
            Trouble.HELD_OTHERWISE, "the view tells: the part lies another way than it seemed"
        )

    async def inspect(self) -> Event:
        """Wait for the views shown so far; decide what comes next."""
        self._tell("judging what was shown")
        await self._collect()
        if self._step(Present) is not None:
            return Event.INSPECTED
        if self._step(HandOver) is not None or self._step(TakeBack) is not None:
            return Event.HAND_OFF_DUE
        if self._step(SetDown) is not None:
            return Event.SET_DOWN_DUE
        await self._require_enough()
        await self._judge()
        return Event.ALL_SEEN

    async def _collect(self, *, learn: bool = True) -> None:
        """Take in what the worker made of the views shown so far.

        Parameters
        ----------
        learn : how the part is held, too; not while a plan is made from what is known of it

        Raises
        ------
        PartTroubleError : the part is not in the hand as it should be
        """
        while self.part.pending:
            shown = self.part.pending[0]
            result = await asyncio.shield(shown.task)
            self.part.pending.pop(0)
            self.part.results.append(result)
            self._journal.record("observation", "view", describe_view(result), self.part.number)
            log.info(
                "view %s: %s",
                result.view_id,
                f"{len(result.findings)} findings" if result.evaluated else result.reason,
            )
            # of a grip that has been given up since nothing more need be known
            if learn and shown.hold is not None and shown.hold is self.part.hold:
                await self._learn_hold(shown, shown.hold, result)

    async def _learn_hold(self, shown: Shown, hold: Hold, result: inspecting.ViewResult) -> None:
        """Take a view as proof of the hold, and its pose as the true one.

        Raises
        ------
        PartTroubleError : the part is held otherwise than planned with, or not seen in the hand
        """
        T_world_part, was_seen = result.T_world_part, hold.is_seen
        if not result.evaluated:
            found = await self._experts.find_hold(
                shown.expected, hold.T_part_hand, shown.holder, shown.backlit
            )
            hold.doubts += 1
            if found is None and was_seen and hold.doubts < DOUBTS_N:
                return  # one bad view is a view less: others have confirmed the hold
            if found is None:
                raise PartTroubleError(
                    Trouble.NOT_IN_HAND,
                    f"the camera does not confirm how the part is held: {result.reason}",
                )
            T_world_part = found
        hold.doubts = 0
        measured = inverse_pose(T_world_part) @ tip_pose(self._layout, shown.q)
        shift_mm, turn_rad = _apart(measured, hold.T_part_hand)
        if was_seen and not is_held_otherwise(shift_mm, turn_rad):
            return
        hold.T_part_hand, hold.is_seen = measured, True
        # what inspection still takes for the grip that was planned can be lived with
        is_bearable = result.evaluated and not self._may_recover(Trouble.HELD_OTHERWISE)
        if is_held_otherwise(shift_mm, turn_rad) and not is_bearable:
            raise PartTroubleError(
                Trouble.HELD_OTHERWISE,
                f"the part sits {shift_mm:.1f} mm and {np.degrees(turn_rad):.1f} degrees from "
                + ("where it was in the hand" if was_seen else "where the grip was planned"),
            )

    async def _require_enough(self) -> None:
        """Plan once more where the views of the plan have truly shown less than they were to.

        Raises
        ------
        PartTroubleError : something is left that could be worth another plan
        """
        part = self.part
        promised, seen = part.promised, part.seen
        if promised is None or part.custody is not Custody.IN_ARM:
            return
        if part.has_tried(Trouble.SEEN_TOO_LITTLE):
            return
        missing = await self._experts.share(promised if seen is None else promised & ~seen)
        if missing >= WORTH_SHARE:
            raise PartTroubleError(
                Trouble.SEEN_TOO_LITTLE,
                f"{100 * missing:.1f} % of the surface was to be shown and was not in sight",
            )

    async def _judge(self) -> None:
        plan = self.part.plan
        assert plan is not None
        unseen = {u.face_id: u.reason for u in plan.unseen}
        results, planned = tuple(self.part.results), dict(self.part.planned)
        verdict = await self._experts.judge(results, unseen, planned)
        self.part.verdict = verdict
        self._journal.record("decision", "verdict", describe_verdict(verdict), self.part.number)


def _apart(T_part_hand: Array, T_other: Array) -> tuple[float, float]:
    """Return how far two grips are apart: the hand's tip on the part [mm], and the turn [rad]."""
    turn = T_part_hand[:3, :3].T @ T_other[:3, :3]
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return float(np.linalg.norm(T_part_hand[:3, 3] - T_other[:3, 3])), angle


def _lamps_for(step: Present) -> tuple[str, ...]:
    """Return the lamps a view is lit with.

    The side lamp's shadows tell pockets and steps on a plane that is looked at squarely; on
    slanting views they fall mostly where the prediction is not trusted.
    """
    return workers.STATION_LAMPS if step.square_to >= 0 else workers.STATION_LAMPS[:1]
