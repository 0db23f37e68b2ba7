"""An arm beside its path: each of its axes stopped on a share of its own of one move.

The axes of a move each run at a whole speed, rounded up, and a start that stops the motions of a
killed controller stops one board up to 0.2 s after the other. So the arm may stand where no path of
the journal leads. From there it goes back to the start of that move, if that is proven.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from controller.arrays import FloatArray
from controller.planning.motion import MARGIN_MM, ProvenMove
from messages import key, say

from .carried import Carried, part_in_gripper
from .classify import Case, Opens, WayOut
from .interrupted import Interrupted
from .world import World


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Beside(Carried):
    """The arm's position, the start of its move, and the grippers' parts, as read.

    Attributes
    ----------
    q, q_begin : (6,) joints
    """

    q: FloatArray
    q_begin: FloatArray

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The arguments of the compute service's `proven_back`."""
        return self.q, self.q_begin, *self.carried


# Proves that the arm goes back from beside its path, with the part of a run, and touches nothing.
Back = Callable[[Interrupted, Beside], Awaitable[ProvenMove]]


def beside_path(left: Interrupted, world: World, case: Case) -> Beside | None:
    """Return the arm's state beside its path for a proof to decide; None if no proof can.

    Only with the part in one gripper, and no jaw that has to open first.

    Parameters
    ----------
    left : state with the path that the arm was sent along last
    world : state of arm and grippers
    case : case found
    """
    if case.person or case.opens is not Opens.NONE or case.leaves is not WayOut.BY_TRAIL:
        return None
    if world.q is None or world.arm_mm is None or left.intent is not None:
        return None
    begin = left.trail.begin_beside(world.q)
    T_part_tcp, T_part_fixed = part_in_gripper(left, case.custody)
    if begin is None or (T_part_tcp is None and T_part_fixed is None):
        return None
    return Beside(
        q=world.q,
        q_begin=begin,
        arm_opening_mm=world.arm_mm,
        T_part_tcp=T_part_tcp,
        fixed_opening_mm=world.fixed_mm,
        T_part_fixed=T_part_fixed,
        around=left.around,
    )


def why_not_back(proven: ProvenMove | None) -> str:
    """Return the reason why an arm beside its path cannot go back.

    Parameters
    ----------
    proven : result of the proof; None if there was none
    """
    person = key("the arm stands beside the path that the journal says it was sent along")
    if proven is None:
        return person
    x, y, z = proven.swept.tcp_mm
    return say(
        "{person}, and going back to where that move began is not proven "
        "free of contact: the arm or what it holds would come too close to "
        "{touches} (TCP about {x:.0f}, {y:.0f}, {z:.0f} mm)",
        person=person,
        touches=proven.swept.touches.replace("_", " "),
        x=x,
        y=y,
        z=z,
    )


def back_evidence(proven: ProvenMove) -> str:
    """Return the evidence for the proven move, as a sentence.

    Parameters
    ----------
    proven : free of contact
    """
    return say(
        "arm: its axes stopped out of step, each on a share of its own of "
        "one and the same move; back to where that began it keeps "
        "{margin_mm:.0f} mm from everything, whichever axis goes first "
        "({pieces} pieces of joint space checked)",
        margin_mm=MARGIN_MM,
        pieces=proven.swept.pieces,
    )
