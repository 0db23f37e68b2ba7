"""Presenting: views of the held part before the inspection camera."""

from controller.planning import Present

from ..lamps import STATION_LAMPS
from ..machine import Event
from ..records import Hold
from ..services import BatchRecord, Disambiguation, Grippers, Imaging, Motion, PlanSteps, Views


class PresentAction:
    """Shows views to the inspection camera until something must be judged first.

    Parameters
    ----------
    steps, motion, grippers, imaging, views, record : services
    disambiguation : finds out what is held, by a view that the plan has for that
    """

    def __init__(
        self,
        steps: PlanSteps,
        motion: Motion,
        grippers: Grippers,
        imaging: Imaging,
        views: Views,
        disambiguation: Disambiguation,
        record: BatchRecord,
    ) -> None:
        self._steps = steps
        self._motion = motion
        self._grippers = grippers
        self._imaging = imaging
        self._views = views
        self._disambiguation = disambiguation
        self._record = record

    async def run(self) -> Event:
        """Show one view after another.

        After each new grasp one view is judged before the next: the hold is verified by sight. In
        a plan made after a recovery, a view that would show nothing new is passed by.

        Raises
        ------
        PartFaultError : the part is gone, or rests in the gripper in another stable pose
        PartProblemError : it is another part
        """
        try:
            while (step := self._steps.next(Present)) is not None:
                started_s = self._steps.begin(step)
                await self._motion.follow(step.motion)
                await self._grippers.require_arm_holds()
                hold = self._record.held()
                if hold.is_seen and not await self._views.is_worth_showing(step):
                    self._steps.end(step, started_s, passed_by=step.view_id)
                    continue
                view = await self._show(step, hold)
                self._steps.end(step, started_s, view=view)
                if not hold.is_seen or self._views.is_hold_questioned():
                    break
        finally:
            await self._imaging.pause("inspection")
        return Event.SHOWN

    async def _show(self, step: Present, hold: Hold) -> str:
        """Take the pictures of a view and have them judged meanwhile; return what it is called."""
        await self._motion.ring_down()
        view = self._views.name(step)
        backlit = await self._imaging.shoot("inspection", {"station_backlight": 1.0})
        lit = {
            lamp: await self._imaging.shoot("inspection", {lamp: 1.0}) for lamp in lamps_for(step)
        }
        q = await self._motion.read_q()
        files = {
            lamp: await self._imaging.save(self._record.part.number, f"{view}_{lamp}", image)
            for lamp, image in {"station_backlight": backlit, **lit}.items()
        }
        self._views.announce(step, files, q)
        if step.doubt is not None:
            await self._disambiguation.resolve(step.doubt, hold, q, backlit, tuple(lit.values()))
        self._views.judge_in_hand(view, hold, q, backlit, lit)
        return view


def lamps_for(step: Present) -> tuple[str, ...]:
    """Return the lamps a view is lit with.

    The side lamp's shadows show pockets and steps on a plane that is looked at squarely; on
    slanting views they fall mostly where the prediction is not trusted.
    """
    return STATION_LAMPS if step.square_to >= 0 else STATION_LAMPS[:1]
