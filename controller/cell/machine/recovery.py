"""The recovery policy: which faults of a part the cell recovers from by itself, and how often.

Plain decisions, no device. Each part fault leads back into the table by one event; planning then
starts from whoever has the part, with what has been seen left out (planning-facts.md 5). After too
many tries a person is asked.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from .table import Event

TRIES_PER_KIND: Final = 2
TRIES_IN_ALL: Final = 6
# of what one grip lets a part be off: beyond it ways and hand-offs are planned anew. A planned grip
# bears 1 mm and 2 degrees (planning-facts.md 2.2); beyond 4 mm the inspection calls it a slip
HOLD_MM: Final = 1.5
HOLD_RAD: Final = float(np.radians(2.0))
WORTH_SHARE: Final = 0.01  # of the surface that a further plan must promise


class PartFault(StrEnum):
    """What may go wrong with a part and be put right without a person; also its code."""

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
    """What the cell does about a part fault.

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

# learnt, rather than gone wrong: these use up nothing of what is allowed in all
LEARNT: Final = frozenset({PartFault.HELD_OTHERWISE, PartFault.SEEN_TOO_LITTLE})


@dataclass(frozen=True, slots=True)
class Recovery:
    """One part fault that the cell set out to recover from."""

    fault: PartFault
    reason: str


def recovery_for(fault: PartFault, past: Sequence[Recovery]) -> RecoveryAction | None:
    """Return what to do about a part fault; None where it has been tried often enough.

    Parameters
    ----------
    fault : which
    past : recoveries of the same part
    """
    action = RECOVERY_ACTIONS[fault]
    tried = sum(one.fault is fault for one in past)
    in_all = sum(one.fault not in LEARNT for one in past)
    if tried >= action.tries or (in_all >= TRIES_IN_ALL and fault not in LEARNT):
        return None
    return action


def is_held_otherwise(shift_mm: float, turn_rad: float) -> bool:
    """Return whether a measured grasp is too far from the one that was planned with."""
    return shift_mm > HOLD_MM or turn_rad > HOLD_RAD
