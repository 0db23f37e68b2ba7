"""Recognising: which part is on the table, in which stable pose, and where."""

from dataclasses import dataclass

import numpy as np

from controller.cad.compiled import part_name
from controller.cell.compute import Compute
from controller.cell.custody import Custody
from controller.cell.devices.lamps import TABLE_LAMPS, TABLE_PANEL
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.machine import Event, PartFault
from controller.cell.services.records import BatchRecord, sightings_row
from controller.config import Recipe
from controller.recognition import Sighting


@dataclass(frozen=True, slots=True, eq=False)
class RecogniseAction:
    """Finds the recipe's part, and it alone, on the table.

    Attributes
    ----------
    compute : recognises, in the worker process
    recipe : says which part is wanted
    record : of the batch; gets what was recognised
    """

    compute: Compute
    recipe: Recipe
    record: BatchRecord

    async def run(self) -> Event:
        """Recognise what the pictures of the table show; return ``PART_RECOGNISED``.

        Raises
        ------
        PartFaultError : the part was lost, and nothing is on the table
        PartProblemError : nothing, too much, or something else is on the table
        """
        self.record.show("recognising")
        part = self.record.part
        lit = {lamp: part.pictures[lamp] for lamp in TABLE_LAMPS}
        sightings = await self.compute.recognise(part.pictures[TABLE_PANEL], lit)
        self.record.note(sightings_row(sightings))
        part.sighting = s = self._choose(sightings)
        part.alternatives = s.ambiguous_with
        if part.custody is not Custody.ON_TABLE:
            part.hold = None
            await self.record.set_custody(Custody.ON_TABLE, "found again")
        self.record.show(
            "recognised",
            part_pose=f"{s.part}, pose {s.pose_index}, x {s.x_mm:.1f} y {s.y_mm:.1f} mm, "
            f"{np.degrees(s.theta_rad):.1f} deg",
        )
        return Event.PART_RECOGNISED

    def _choose(self, sightings: tuple[Sighting, ...]) -> Sighting:
        """Return the one sighting of the recipe's part."""
        if not sightings:
            raise self._nothing_found()
        if len(sightings) > 1:
            where = "; ".join(
                f"{s.part or 'unknown object'} at x {s.x_mm:.0f}, y {s.y_mm:.0f} mm"
                + (", touching another" if s.touching_count else "")
                for s in sightings
            )
            raise PartProblemError(
                "many_parts",
                f"{len(sightings)} objects on the table: {where}; leave one part and start again",
            )
        (seen,) = sightings
        expected = part_name(self.recipe.part)
        if seen.part is None:
            raise PartProblemError(
                "unknown_object",
                f"the object at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm: {seen.reason}; "
                "take it away, or check the recipe's `part:`",
            )
        if seen.is_cut:
            raise PartProblemError(
                "part_cut_off",
                f"{seen.part} at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm lies partly outside the "
                f"backlit area: {100 * seen.free_share:.0f} % of its outline is seen; move it "
                "inwards and start again",
            )
        if seen.part != expected:
            raise PartProblemError(
                "wrong_part",
                f"{seen.part} is at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm, the recipe is for "
                f"{expected}; put that there, or start with a recipe for {seen.part}",
            )
        return seen

    def _nothing_found(self) -> PartProblemError:
        part = self.record.part
        if part.custody is Custody.ON_TABLE:
            return PartProblemError(
                "no_part", "no part on the table: lay one on the backlit area and start again"
            )
        lost = next(r for r in reversed(part.recoveries) if r.fault is not PartFault.NOT_SEEN)
        return PartFaultError(
            PartFault.NOT_SEEN,
            f"{lost.reason}; the camera over the table does not see it: look "
            + (
                "below the arm's last path, and at the fixed gripper"
                if part.custody is Custody.LOST
                else "at what the arm gripper holds"
            ),
            code=lost.fault.value,
        )
