"""Actions that look and think: pictures of the table, recognition, plan, views, verdict."""

import asyncio
import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.cad import inverse_pose
from controller.cad.compiled import part_name
from controller.planning import HandOver, NoPlanError, Present, shown_pose
from controller.recognition import Sighting

from . import workers
from .errors import CellError, PartProblemError
from .holder import holder_boxes, tip_pose
from .machine import Event
from .records import PartRecord, describe_sighting, describe_verdict, describe_view
from .toolkit import Toolkit

log = logging.getLogger(__name__)

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

LEAST_GLOW = 60  # of 255; a glowing table shows 150 and more
SETTLE_S = 0.3  # a long arm rings after it stops


class Looking(Toolkit):
    """What the cell sees and makes of it."""

    async def acquire(self) -> Event:
        """Take the pictures of the table: glowing, then under each of its lamps."""
        if self.part.tray is not None or self.part.number == 0:
            self.part = PartRecord(number=self.part.number + 1)
        self.part.next_step = 0
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
        names = {lamp: await self._save(lamp, image) for lamp, image in self.part.pictures.items()}
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
        sightings = await self._compute(
            workers.recognise, self.part.pictures["table_backlight"], lit
        )
        self._journal.record(
            "observation",
            "sightings",
            {"sightings": [describe_sighting(s) for s in sightings]},
            self.part.number,
        )
        self.part.sighting = self._choose(sightings)
        s = self.part.sighting
        self._tell(
            "recognised",
            part_pose=f"{s.part}, pose {s.pose_index}, x {s.x_mm:.1f} y {s.y_mm:.1f} mm, "
            f"{np.degrees(s.theta_rad):.1f} deg",
        )
        return Event.PART_RECOGNISED

    def _choose(self, sightings: tuple[Sighting, ...]) -> Sighting:
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
        """Decide how to take it, what to show, where to pass it over."""
        self._tell("planning")
        sighting = self.part.sighting
        assert sighting is not None
        assert sighting.T_world_part is not None
        try:
            if self._preparing is not None:
                await self._preparing
            plan = await self._compute(workers.plan, sighting.pose_index, sighting.T_world_part)
        except NoPlanError as error:
            raise PartProblemError("no_plan", str(error)) from error
        self.part.plan = plan
        self.part.next_step = 0
        self._journal.record(
            "decision",
            "plan",
            {
                "steps": [label for label, _ in plan.seconds_by_step],
                "seconds": [round(seconds, 2) for _, seconds in plan.seconds_by_step],
                "forecast_s": round(plan.forecast_s, 1),
                "covered_fraction": round(plan.covered_fraction, 4),
                "reachable_fraction": round(plan.reachable_fraction, 4),
                "unseen": [
                    {"face": u.face_id, "area_fraction": u.area_fraction, "reason": u.reason}
                    for u in plan.unseen
                ],
            },
            self.part.number,
        )
        return Event.PLANNED

    async def present(self) -> Event:
        """Show views to the inspection camera until something must be judged first.

        After each new grip one view is judged before the next: the hold is verified by sight.
        """
        camera = self._devices.inspection
        try:
            while (step := self._step(Present)) is not None:
                started = self._begin(step)
                await self._move(step.motion)
                await self._require_held()
                await self._clock.sleep(SETTLE_S)
                pictures = {
                    "station_backlight": await self._shoot("inspection", {"station_backlight": 1.0})
                }
                for lamp in _lamps_for(step):
                    pictures[lamp] = await self._shoot("inspection", {lamp: 1.0})
                q = await self._devices.arm.read_q()
                names = {
                    lamp: await self._save(f"{step.view_id}_{lamp}", image)
                    for lamp, image in pictures.items()
                }
                self._journal.record(
                    "observation",
                    "view_pictures",
                    {"view": step.view_id, "pictures": names, "q": q.tolist()},
                    self.part.number,
                )
                self._submit(step, q, pictures)
                self._end(step, started, view=step.view_id)
                if not self.part.is_hold_seen:
                    return Event.SHOWN
        finally:
            await camera.pause()
        return Event.SHOWN

    def _submit(self, step: Present, q: Array, pictures: Mapping[str, Grey]) -> None:
        """Hand a view to the worker; it is judged while the arm goes to the next one."""
        grip = self.part.T_part_hand
        assert grip is not None
        expected = shown_pose(self._layout, q, grip)
        holder = holder_boxes(self._layout, q, self.part.gripped_mm)
        lit = {lamp: pictures[lamp] for lamp in _lamps_for(step)}
        task = asyncio.ensure_future(
            self._compute(
                workers.inspect,
                step.view_id,
                expected,
                holder,
                pictures["station_backlight"],
                lit,
                self.part.is_hold_seen,
            )
        )
        self.part.pending.append((q, task))

    async def inspect(self) -> Event:
        """Wait for the views shown so far; decide what comes next."""
        self._tell("judging what was shown")
        while self.part.pending:
            q, task = self.part.pending[0]
            result = await task
            self.part.pending.pop(0)
            self.part.results.append(result)
            self._journal.record("observation", "view", describe_view(result), self.part.number)
            log.info(
                "view %s: %s",
                result.view_id,
                f"{len(result.findings)} findings" if result.evaluated else result.reason,
            )
            if not self.part.is_hold_seen:
                self._see_hold(q, result)
        if self._step(Present) is not None:
            return Event.INSPECTED
        if self._step(HandOver) is not None:
            return Event.HAND_OFF_DUE
        await self._judge()
        return Event.ALL_SEEN

    def _see_hold(self, q: Array, result: inspecting.ViewResult) -> None:
        """Take the first view under a grip as proof of the hold, and its pose as the true one."""
        if not result.evaluated:
            raise PartProblemError(
                "hold_not_seen",
                f"the camera does not confirm how the part is held: {result.reason}",
            )
        self.part.is_hold_seen = True
        self.part.T_part_hand = inverse_pose(result.T_world_part) @ tip_pose(self._layout, q)

    async def _judge(self) -> None:
        plan = self.part.plan
        assert plan is not None
        unseen = {u.face_id: u.reason for u in plan.unseen}
        verdict = await self._compute(workers.judge, tuple(self.part.results), unseen)
        self.part.verdict = verdict
        self._journal.record("decision", "verdict", describe_verdict(verdict), self.part.number)


def _lamps_for(step: Present) -> tuple[str, ...]:
    """Return the lamps a view is lit with.

    The side lamp's shadows tell pockets and steps on a plane that is looked at squarely; on
    slanting views they fall mostly where the prediction is not trusted.
    """
    return workers.STATION_LAMPS if step.square_to >= 0 else workers.STATION_LAMPS[:1]
