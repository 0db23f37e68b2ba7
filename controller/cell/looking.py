"""Actions that find the part: pictures of the table, and what lies there."""

import logging

import numpy as np
from numpy.typing import NDArray

from controller.cad.compiled import part_name
from controller.recognition import Sighting

from . import workers
from .custody import Custody
from .deciding import Deciding
from .errors import CellError, PartProblemError
from .machine import Event
from .records import PartRecord, describe_sighting

log = logging.getLogger(__name__)

Grey = NDArray[np.uint8]

LEAST_GLOW = 60  # of 255; a glowing table shows 150 and more


class Looking(Deciding):
    """What the cell sees of the table."""

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
        return seen
