"""The recovery policy: which faults of a part the cell recovers from by itself, and how often.

Plain decisions, no device. The recovery action of a part fault is one event of the table; planning
then starts from the gripper or table that has the part, and leaves out what has been seen
(planning-facts.md 5). After too many tries the cell holds for a person.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from .table import Event

TRIES_PER_KIND: Final = 2
TRIES_IN_ALL: Final = 6
# How far a part may be from its planned grasp before paths and hand-offs are planned anew. A
# planned grasp tolerates 1 mm and 2 degrees (planning-facts.md 2.2); inspection takes more than
# 4 mm for a slip.
HOLD_MM: Final = 1.5
HOLD_RAD: Final = float(np.radians(2.0))
# A further plan must promise to show this share of the surface.
WORTH_SHARE: Final = 0.01


class PartFault(StrEnum):
    """What may go wrong with a part and may be recovered from; the value is its code."""

    GRASP_MISSED = "grip_missed"
    GRASP_WRONG = "grip_wrong"
    DROPPED = "part_lost"
    HOLD_NOT_SEEN = "hold_not_seen"
    HELD_OTHERWISE = "held_otherwise"
    HAND_OFF_FAILED = "hand_off_failed"
    RECEIVE_FAILED = "take_back_failed"
    SEEN_TOO_LITTLE = "seen_too_little"


@dataclass(frozen=True, slots=True)
class RecoveryAction:
    """A recovery action: what leads back to the work after a part fault.

    Attributes
    ----------
    event : leads to the state that does it
    words : for the operator
    tries : how often for one part
    """

    event: Event
    words: str
    tries: int = TRIES_PER_KIND


RECOVERY_ACTIONS: Final[Mapping[PartFault, RecoveryAction]] = {
    PartFault.GRASP_MISSED: RecoveryAction(Event.GRASP_MISSED, "looking at the table again"),
    PartFault.GRASP_WRONG: RecoveryAction(Event.GRASP_MISSED, "looking at the table again"),
    PartFault.DROPPED: RecoveryAction(Event.PART_DROPPED, "looking where the part has fallen"),
    PartFault.HOLD_NOT_SEEN: RecoveryAction(
        Event.PART_DROPPED, "looking for the part on the table"
    ),
    PartFault.HELD_OTHERWISE: RecoveryAction(
        Event.PLAN_VOID, "planning on from the grasp as measured", 4
    ),
    PartFault.HAND_OFF_FAILED: RecoveryAction(Event.PLAN_VOID, "planning on from the arm gripper"),
    PartFault.RECEIVE_FAILED: RecoveryAction(Event.PLAN_VOID, "planning on from the fixed gripper"),
    PartFault.SEEN_TOO_LITTLE: RecoveryAction(
        Event.PLAN_VOID, "planning what is still to be shown", 1
    ),
}

# These are measurements rather than failures: they do not count towards TRIES_IN_ALL.
LEARNT: Final = frozenset({PartFault.HELD_OTHERWISE, PartFault.SEEN_TOO_LITTLE})


@dataclass(frozen=True, slots=True)
class Recovery:
    """A part fault that the cell set out to recover from."""

    fault: PartFault
    reason: str


def recovery_for(fault: PartFault, past: Sequence[Recovery]) -> RecoveryAction | None:
    """Return the recovery action for a part fault; None where the tries are used up.

    Parameters
    ----------
    fault : to recover from
    past : recoveries of the same part
    """
    action = RECOVERY_ACTIONS[fault]
    tried = sum(one.fault is fault for one in past)
    in_all = sum(one.fault not in LEARNT for one in past)
    if tried >= action.tries or (in_all >= TRIES_IN_ALL and fault not in LEARNT):
        return None
    return action


def is_held_otherwise(shift_mm: float, turn_rad: float) -> bool:
    """Return whether a measured grasp is too far from the planned one."""
    return shift_mm > HOLD_MM or turn_rad > HOLD_RAD
