"""The fault policy as data, and the decision by it: the act on a part fault, and how often.

Plain decisions, no device. Each class of fault has a list of actions; each is taken a set number of
times for one part, and the last one ends the list. An action that continues the work is one event
of the table; planning then starts from the gripper or table that has the part, without the surface
already seen (planning-facts.md 5). The policy itself comes from the cell file and the recipe.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from messages import key

from .table import Event

# How far a part may be from its planned grasp before paths and hand-offs are planned anew. A
# planned grasp tolerates 1 mm and 2 degrees (planning-facts.md 2.2); inspection takes more than
# 4 mm for a slip.
HOLD_MM: Final = 1.5
HOLD_RAD: Final = float(np.radians(2.0))
# A further plan must promise to show this share of the surface.
WORTH_SHARE: Final = 0.01


class PartFault(StrEnum):
    """A fault of a part that may be recovered from; the value is its code."""

    GRASP_MISSED = key("grip_missed")
    GRASP_WRONG = key("grip_wrong")
    DROPPED = key("part_lost")
    NOT_SEEN = key("part_not_seen")
    HOLD_NOT_SEEN = key("hold_not_seen")
    HELD_OTHERWISE = key("held_otherwise")
    HAND_OFF_FAILED = key("hand_off_failed")
    RECEIVE_FAILED = key("take_back_failed")
    SEEN_TOO_LITTLE = key("seen_too_little")
    AMBIGUOUS = key("ambiguous")

    @property
    def policy_key(self) -> str:
        """Its name in the section `faults` of recipe and cell files."""
        return self.name.lower()


class Act(StrEnum):
    """An action of the policy; the value is its name in recipe and cell files."""

    RETRY = key("retry")
    RE_POSE = key("re_pose")
    REGRASP = key("regrasp")
    OTHER_VIEW = key("other_view")
    SKIP = key("skip_characteristic")
    PARK = key("park_part")
    HOLD = key("hold")
    ABORT = key("abort")


ENDS: Final = frozenset({Act.SKIP, Act.PARK, Act.HOLD, Act.ABORT})


@dataclass(frozen=True, slots=True)
class Rung:
    """One action of a ladder.

    Attributes
    ----------
    act : the action
    times : number of times for one part
    delay_s : wait so long before it [cell s]
    """

    act: Act
    times: int = 1
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class FaultPolicy:
    """The cell's acts on each class of fault.

    Attributes
    ----------
    ladders : actions by name of the class; the last of each ends the matter
    times_in_all : recoveries of one part, those of `LEARNT` aside
    """

    ladders: Mapping[str, tuple[Rung, ...]]
    times_in_all: int


# The event that leads back to the work, and in words where to.
BACK: Final[Mapping[PartFault, tuple[Event, str]]] = {
    PartFault.GRASP_MISSED: (Event.GRASP_MISSED, key("looking at the table again")),
    PartFault.GRASP_WRONG: (Event.GRASP_MISSED, key("looking at the table again")),
    PartFault.DROPPED: (Event.PART_DROPPED, key("looking for the fallen part")),
    PartFault.NOT_SEEN: (Event.PART_NOT_SEEN, key("looking at the table once more")),
    PartFault.HOLD_NOT_SEEN: (Event.PART_DROPPED, key("looking for the part on the table")),
    PartFault.HELD_OTHERWISE: (Event.PLAN_VOID, key("planning onwards from the measured grasp")),
    PartFault.HAND_OFF_FAILED: (Event.PLAN_VOID, key("planning onwards from the arm gripper")),
    PartFault.RECEIVE_FAILED: (Event.PLAN_VOID, key("planning onwards from the fixed gripper")),
    PartFault.SEEN_TOO_LITTLE: (Event.PLAN_VOID, key("planning the remaining views")),
    PartFault.AMBIGUOUS: (Event.PLAN_VOID, key("bringing the part to a tray")),
}
PARKING: Final = (Event.PLAN_VOID, key("parking the part in the quarantine tray"))
# Faults in which a gripper still has the part and its pose in it is known: it may be parked.
STILL_HELD: Final = frozenset(
    {
        PartFault.HELD_OTHERWISE,
        PartFault.HAND_OFF_FAILED,
        PartFault.RECEIVE_FAILED,
        PartFault.SEEN_TOO_LITTLE,
        PartFault.AMBIGUOUS,
    }
)
# These are measurements rather than failures: they do not count towards `times_in_all`.
LEARNT: Final = frozenset({PartFault.HELD_OTHERWISE, PartFault.SEEN_TOO_LITTLE})


@dataclass(frozen=True, slots=True)
class Recovery:
    """A part fault, and the cell's recovery: the first outcome stays on record."""

    fault: PartFault
    reason: str
    act: Act = Act.RE_POSE


def next_rung(ladder: Sequence[Rung], done_count: int) -> Rung:
    """Return the action of a ladder after a number of attempts; past the end, the last one."""
    for rung in ladder[:-1]:
        if done_count < rung.times:
            return rung
        done_count -= rung.times
    return ladder[-1]


def decide(
    policy: FaultPolicy, fault: PartFault, past: Sequence[Recovery], *, is_parked: bool = False
) -> Rung:
    """Return the next rung of the fault's ladder.

    Parameters
    ----------
    policy : policy of the cell and the recipe
    fault : fault to decide on
    past : recoveries of the same part
    is_parked : the part is on its way to the quarantine tray already: what would park it holds
    """
    ladder = policy.ladders[fault.policy_key]
    end = ladder[-1]
    if end.act is Act.PARK and (is_parked or fault not in STILL_HELD):
        end = Rung(Act.HOLD)
    tried = sum(one.fault is fault for one in past)
    in_all = sum(one.fault not in LEARNT for one in past)
    if in_all >= policy.times_in_all and fault not in LEARNT:
        return end
    rung = next_rung(ladder, tried)
    return end if rung.act in ENDS else rung


def is_held_otherwise(shift_mm: float, turn_rad: float) -> bool:
    """Return whether a measured grasp is too far from the planned one."""
    return shift_mm > HOLD_MM or turn_rad > HOLD_RAD
