"""Decides by a disambiguation view which part the arm gripper holds, in which pose."""

from dataclasses import dataclass

from controller.arrays import FloatArray, Grey
from controller.cell.compute import Compute
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal.rows import AmbiguityResolved
from controller.cell.machine import PartFault
from controller.cell.services.records import BatchRecord, PartInGripper
from controller.imaging import inverse_pose
from controller.planning import Ambiguity
from messages import joined, key, say

TAKE_OUT = key("take it out with `cellctl recover --open arm`")


@dataclass(frozen=True, slots=True, eq=False)
class Disambiguation:
    """Compares a view with every hypothesis on the part in the gripper."""

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
        q : (6,) present joints of the arm
        backlit, lit : pictures of the view

        Raises
        ------
        PartFaultError : it is in another stable pose than the plan's; it is another part, or
            several hypotheses are left
        PartProblemError : no hypothesis is left
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
                "unknown_object",
                say(
                    "the part in the arm gripper matches none of {names}; {take_out}, "
                    "check it for damage and the recipe's `part:`",
                    names=", ".join(names),
                    take_out=TAKE_OUT,
                ),
            )
        if len(left) > 1:
            raise PartFaultError(
                PartFault.AMBIGUOUS,
                say(
                    "the view does not decide between {listed}",
                    listed=_listed([names[k] for k in left]),
                ),
            )
        found = ambiguity.hypotheses[left[0]]
        if found.name != names[0]:
            raise PartFaultError(
                PartFault.AMBIGUOUS,
                say(
                    "the part in the arm gripper is {name}, the recipe is for {names}",
                    name=found.name,
                    names=names[0],
                ),
            )
        hold.T_part_tcp = inverse_pose(found.T_tcp_part)
        self.record.note_hold()
        raise PartFaultError(
            PartFault.HELD_OTHERWISE, key("the view shows a stable pose other than expected")
        )


def _listed(names: list[str]) -> str:
    """Return the remaining parts, in words; hypotheses of one part differ by its pose."""
    parts = list(dict.fromkeys(names))
    return (
        joined(" and ", parts)
        if len(parts) > 1
        else say("{names_count} poses of {parts}", names_count=len(names), parts=parts[0])
    )
