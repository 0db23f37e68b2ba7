"""Actions that look and think: pictures of the table, recognition, plan, views, verdict."""

import asyncio
import logging
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.cad import inverse_pose
from controller.cad.compiled import part_name
from controller.planning import (
    HandOver,
    InArm,
    InFixture,
    Look,
    NoPlanError,
    OnTable,
    Plan,
    Present,
    SetDown,
    Start,
    TakeBack,
    shown_pose,
)
from controller.recognition import Sighting

from . import workers
from .custody import Custody
from .errors import CellError, PartProblemError, PartTroubleError
from .handling import Handling
from .holder import holder_boxes, tip_pose
from .machine import Event
from .records import (
    Hold,
    PartRecord,
    Shown,
    describe_plan,
    describe_sighting,
    describe_verdict,
    describe_view,
)
from .recovery import WORTH_SHARE, Trouble, is_held_otherwise, merged

log = logging.getLogger(__name__)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]

LEAST_GLOW = 60  # of 255; a glowing table shows 150 and more
DOUBTS_N = 2  # bad views in a row after which a hold that was seen is no longer believed
SAME_PLACE = np.array([0.01, 0.01, 0.01, 0.5, 0.01, 0.01])  # [rad, mm] of joints: servo and counts
SETTLE_S = 0.3  # a long arm rings after it stops


class Looking(Handling):
    """What the cell sees and makes of it."""

    async def acquire(self) -> Event:
        """Take the pictures of the table: glowing, then under each of its lamps."""
        if self.part.tray is not None or self.part.number == 0:
            self.part = PartRecord(number=self.part.number + 1)
        self.part.plan, self.part.next_step = None, 0
        self._tell("taking pictures of the table", step=0, step_count=0, remaining_s=None)
        camera = self._devices.overhead
        try:
            glowing = await self._shoot("overhead", {"table_backlight": 1.0})
            self._check_glow(glowing)
            self.part.pictures = {"table_backlight": glowing}
            for lamp in workers.TABLE_LAMPS:
                self.part.pictures[lamp] = await self._shoot("overhead", {lamp: 1.0})
        finally:
            await camera.pause()
        self.part.look_count += 1
        again = f"_look{self.part.look_count}" if self.part.look_count > 1 else ""
        names = {
            lamp: await self._save(lamp + again, image)
            for lamp, image in self.part.pictures.items()
        }
        self.part.picture_names = names
        self._journal.record("observation", "table_pictures", names, self.part.number)
        return Event.PICTURE_TAKEN

    def _check_glow(self, picture: Grey) -> None:
        """Raise CellError where the table does not glow: that is no empty table."""
        level = float(np.quantile(picture[::8, ::8], 0.9))
        if level < LEAST_GLOW:
            raise CellError(
                f"the table does not glow (grey level {level:.0f}, {LEAST_GLOW} is the least): "
                "check the lamp table_backlight, its relay and its supply, and the lens cap"
            )

    async def recognise(self) -> Event:
        """Find out which part it is, which way up it lies and where."""
        self._tell("recognising")
        lit = {lamp: self.part.pictures[lamp] for lamp in workers.TABLE_LAMPS}
        sightings = await self._experts.recognise(self.part.pictures["table_backlight"], lit)
        self._journal.record(
            "observation",
            "sightings",
            {"sightings": [describe_sighting(s) for s in sightings]},
            self.part.number,
        )
        self.part.sighting = self._choose(sightings)
        self.part.candidates = self.part.sighting.ambiguous_with
        if self.part.custody is not Custody.ON_TABLE:
            self.part.hold = None
            await self._custody(Custody.ON_TABLE, "found again")
        s = self.part.sighting
        self._tell(
            "recognised",
            part_pose=f"{s.part}, pose {s.pose_index}, x {s.x_mm:.1f} y {s.y_mm:.1f} mm, "
            f"{np.degrees(s.theta_rad):.1f} deg",
        )
        return Event.PART_RECOGNISED

    def _choose(self, sightings: tuple[Sighting, ...]) -> Sighting:
        if not sightings and self.part.custody is not Custody.ON_TABLE:
            lost = self.part.recoveries[-1]
            raise PartProblemError(
                lost.trouble.value,
                f"{lost.reason}; it does not lie where the camera over the table sees: look "
                + (
                    "below the arm's last way, and at the fixed gripper"
                    if self.part.custody is Custody.LOST
                    else "at what the hand holds"
                ),
            )
        if not sightings:
            raise PartProblemError(
                "no_part", "no part on the table: lay one on the glowing area and start again"
            )
        if len(sightings) > 1:
            where = "; ".join(
                f"{s.part or 'unknown object'} at x {s.x_mm:.0f}, y {s.y_mm:.0f} mm"
                for s in sightings
            )
            raise PartProblemError(
                "many_parts", f"{len(sightings)} objects on the table, one is allowed: {where}"
            )
        (seen,) = sightings
        expected = part_name(self._recipe.part)
        if seen.part is None:
            raise PartProblemError(
                "unknown_object",
                f"the object at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm: {seen.reason}",
            )
        if seen.part != expected:
            raise PartProblemError(
                "wrong_part",
                f"{seen.part} lies at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm, the recipe is for "
                f"{expected}",
            )
        others = [a for a in seen.ambiguous_with if a.part != seen.part]
        if others:
            raise PartProblemError(
                "ambiguous", f"the object may be {seen.part} or {others[0].part}; turn it over"
            )
        return seen

    async def plan(self) -> Event:
        """Decide how to go on from whoever has the part, leaving out what has been seen."""
        self._tell("planning")
        part, before = self.part, self.part.plan
        await self._collect(learn=False)
        await self._measure_hold()
        start = await self._start()
        try:
            if self._preparing is not None:
                await self._preparing
            plan = await self._experts.plan(
                start, part.seen, frozenset(part.avoid), part.candidates
            )
        except NoPlanError as error:
            return self._plan_failed(error, start, before)
        is_more = part.recoveries and part.recoveries[-1].trouble is Trouble.SEEN_TOO_LITTLE
        if is_more and await self._experts.share(_new(plan, part.seen)) < WORTH_SHARE:
            return Event.PLANNED_ON  # nothing to be gained: the plan there was goes on to its end
        part.plan, part.next_step = plan, 0
        part.plan_count += 1
        self._journal.record("decision", "plan", describe_plan(plan), part.number)
        return Event.PLANNED if isinstance(start, OnTable) else Event.PLANNED_ON

    async def _measure_hold(self) -> None:
        """Look how the part is held, where the arm stands before the camera just now.

        Raises
        ------
        PartTroubleError : it is not seen in the hand
        """
        hold, shown = self.part.hold, self._last_shown
        if hold is None or hold.is_seen or shown is None:
            return
        q = await self._devices.arm.read_q()
        if (np.abs(q - shown.q) > SAME_PLACE).any():
            return
        await self._clock.sleep(SETTLE_S)
        backlit = await self._shoot("inspection", {"station_backlight": 1.0})
        expected = shown_pose(self._layout, q, hold.T_part_hand)
        holder = holder_boxes(self._layout, q, hold.width_mm)
        found = await self._experts.find_hold(expected, hold.T_part_hand, holder, backlit)
        if found is None:
            raise PartTroubleError(
                Trouble.NOT_IN_HAND, "the camera does not see the part in the hand"
            )
        hold.T_part_hand = inverse_pose(found) @ tip_pose(self._layout, q)
        hold.is_seen = True

    async def _start(self) -> Start:
        """Return who has the part, as measured."""
        part = self.part
        match part.custody:
            case Custody.ON_TABLE:
                sighting = part.sighting
                assert sighting is not None
                assert sighting.T_world_part is not None
                return OnTable(sighting.pose_index, sighting.T_world_part)
            case Custody.IN_ARM:
                hold = self._held()
                grip = replace(hold.grip, T_part_hand=hold.T_part_hand, opening_mm=hold.width_mm)
                return InArm(grip, await self._devices.arm.read_q())
            case Custody.IN_FIXTURE if part.fixture_grip is not None:
                return InFixture(part.fixture_grip, await self._devices.arm.read_q())
        raise PartProblemError("no_plan", f"the part is {part.custody.value}: nothing to plan from")

    def _plan_failed(self, error: NoPlanError, start: Start, before: Plan | None) -> Event:
        """Go on with the plan there was, where the part is still held; ask a person otherwise.

        A failed hand-off left the arm where that step began, so that it may be tried once more.
        """
        if isinstance(start, OnTable) or before is None:
            raise PartProblemError("no_plan", str(error)) from error
        log.info("no new plan (%s): on with the one there was", error)
        self._journal.record("decision", "plan_kept", {"reason": str(error)}, self.part.number)
        return Event.PLANNED_ON

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
                if hold.is_seen and not self._is_worth(step):
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
        lit = {lamp: part.pictures[lamp] for lamp in workers.TABLE_LAMPS}
        view = self._name(step)
        self._journal.record(
            "observation",
            "view_pictures",
            {"view": view, "pictures": part.picture_names, "q": []},
            part.number,
        )
        task = asyncio.ensure_future(self._counted(view, T, glowing, lit, step))
        part.pending.append(Shown(view, None, np.zeros(6), T, (), glowing, task))

    async def _counted(
        self, view: str, T: Array, glowing: Grey, lit: Mapping[str, Grey], step: Look
    ) -> inspecting.ViewResult:
        """Judge a view of the lying part; it counts for what the plan says it resolves."""
        result = await self._experts.inspect_lying(view, T, glowing, lit)
        return replace(result, seen=result.seen & step.seen)

    def _name(self, step: Present | Look) -> str:
        """Return what a view is called: plans after the first one begin to count anew."""
        plan = self.part.plan_count
        return step.view_id if plan < 2 else f"{step.view_id}~{plan}"

    def _is_worth(self, step: Present) -> bool:
        seen = self.part.seen
        if seen is None or not self.part.recoveries:
            return True
        return bool((step.seen & ~seen).any())

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
        expected = shown_pose(self._layout, q, hold.T_part_hand)
        holder = holder_boxes(self._layout, q, hold.width_mm)
        task = asyncio.ensure_future(
            self._experts.inspect(view, expected, holder, backlit, lit, hold.is_seen)
        )
        self._last_shown = Shown(view, hold, q, expected, holder, backlit, task)
        self.part.pending.append(self._last_shown)

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
            result = await shown.task
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
                f"{100 * missing:.1f} % of the surface was to be shown and could not be compared",
            )

    async def _judge(self) -> None:
        plan = self.part.plan
        assert plan is not None
        unseen = {u.face_id: u.reason for u in plan.unseen}
        verdict = await self._experts.judge(tuple(self.part.results), unseen)
        self.part.verdict = verdict
        self._journal.record("decision", "verdict", describe_verdict(verdict), self.part.number)


def _new(plan: Plan, seen: Mask | None) -> Mask:
    """Return which samples (n,) a plan shows that have not been seen."""
    promised = merged([s.seen for s in plan.steps if isinstance(s, Present | Look)])
    if promised is None:
        return np.zeros(0 if seen is None else len(seen), dtype=bool)
    return promised if seen is None else promised & ~seen


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
