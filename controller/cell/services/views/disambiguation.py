"""Decides what the arm gripper holds, by a disambiguation view."""

from dataclasses import dataclass

from controller.arrays import FloatArray, Grey
from controller.cell.compute import Compute
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal.rows import AmbiguityResolved
from controller.cell.machine import PartFault
from controller.cell.services.records import BatchRecord, PartInGripper
from controller.imaging import inverse_pose
from controller.planning import Ambiguity


@dataclass(frozen=True, slots=True, eq=False)
class Disambiguation:
    """Compares a view with every hypothesis of what is held."""

    compute: Compute
    record: BatchRecord

    async def resolve(
        self,
        ambiguity: Ambiguity,
        hold: PartInGripper,
        q: FloatArray,
        backlit: Grey,
        lit: tuple[Grey, ...],
    ) -> None:
        """Check that the view leaves one hypothesis, the one that the plan was made for.

        Parameters
        ----------
        ambiguity : the hypotheses
        hold : corrected where another hypothesis is left
        q : (6,) where the arm stands
        backlit, lit : pictures of the view

        Raises
        ------
        PartFaultError : the part, in another stable pose than the plan's
        PartProblemError : another part, or not exactly one hypothesis is left
        """
        part, names = self.record.part, [c.name for c in ambiguity.hypotheses]
        left = await self.compute.identify(ambiguity, q, hold.opening_mm, backlit, lit)
        part.alternatives = ()
        self.record.note(
            AmbiguityResolved(
                between=tuple(names), left=tuple(names[k] for k in left), light=ambiguity.light
            )
        )
        if left == (0,):
            return
        if not left:
            raise PartProblemError(
                "unknown_object", f"the part in the gripper looks like none of {', '.join(names)}"
            )
        if len(left) > 1:
            raise PartProblemError(
                "ambiguous",
                f"it may still be {' or '.join(names[k] for k in left)}; look at what "
                "the arm gripper holds",
            )
        found = ambiguity.hypotheses[left[0]]
        if found.name != names[0]:
            raise PartProblemError(
                "wrong_part", f"the view shows {found.name}, the recipe is for {names[0]}"
            )
        hold.T_part_tcp = inverse_pose(found.T_tcp_part)
        raise PartFaultError(
            PartFault.HELD_OTHERWISE, "the view shows another stable pose than it seemed"
        )
