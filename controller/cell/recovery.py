"""What the cell does about trouble with a part: which ones it gets over itself, and how often.

Plain decisions, no device. Each trouble leads back into the table by one event; planning then
starts from whoever has the part, with what has been seen left out (planning.md 5). Tried too
often, the trouble is a person's.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .machine import Event

Array = NDArray[np.float64]

TRIES_PER_KIND: Final = 2
TRIES_IN_ALL: Final = 6
# of what one grip lets a part be off: beyond it ways and hand-offs are planned anew. A planned grip
# bears 1 mm and 2 degrees (planning.md 2.2); beyond 4 mm the inspection calls it a slip
HOLD_MM: Final = 1.5
HOLD_RAD: Final = float(np.radians(2.0))
WORTH_SHARE: Final = 0.01  # of the surface that a further plan must promise


class Trouble(StrEnum):
    """What may go wrong with a part and be put right without a person; also its code."""

    GRIP_MISSED = "grip_missed"
    GRIP_WRONG = "grip_wrong"
    DROPPED = "part_lost"
    NOT_IN_HAND = "hold_not_seen"
    HELD_OTHERWISE = "held_otherwise"
    HAND_OFF_FAILED = "hand_off_failed"
    TAKE_BACK_FAILED = "take_back_failed"
    SEEN_TOO_LITTLE = "seen_too_little"


@dataclass(frozen=True, slots=True)
class Remedy:
    """How a trouble is got over.

    Attributes
    ----------
    event : leads to the state that does it
    words : for the operator
    tries : how often for one part
    """

    event: Event
    words: str
    tries: int = TRIES_PER_KIND


REMEDIES: Final[Mapping[Trouble, Remedy]] = {
    Trouble.GRIP_MISSED: Remedy(Event.GRIP_MISSED, "looking at the table again"),
    Trouble.GRIP_WRONG: Remedy(Event.GRIP_MISSED, "looking at the table again"),
    Trouble.DROPPED: Remedy(Event.PART_DROPPED, "looking where the part has fallen"),
    Trouble.NOT_IN_HAND: Remedy(Event.PART_DROPPED, "looking for the part on the table"),
    Trouble.HELD_OTHERWISE: Remedy(Event.PLAN_VOID, "planning on from the grip as it is", 4),
    Trouble.HAND_OFF_FAILED: Remedy(Event.PLAN_VOID, "planning on from the hand"),
    Trouble.TAKE_BACK_FAILED: Remedy(Event.PLAN_VOID, "planning on from the fixed gripper"),
    Trouble.SEEN_TOO_LITTLE: Remedy(Event.PLAN_VOID, "planning what is still to be shown", 1),
}

# learnt, rather than gone wrong: these use up nothing of what is allowed in all
LEARNT: Final = frozenset({Trouble.HELD_OTHERWISE, Trouble.SEEN_TOO_LITTLE})


@dataclass(frozen=True, slots=True)
class Recovery:
    """One trouble that the cell set out to get over by itself."""

    trouble: Trouble
    reason: str


def remedy_for(trouble: Trouble, past: Sequence[Recovery]) -> Remedy | None:
    """Return what to do about a trouble; None where it has been tried often enough.

    Parameters
    ----------
    past : recoveries of the same part
    """
    remedy = REMEDIES[trouble]
    tried = sum(one.trouble is trouble for one in past)
    in_all = sum(one.trouble not in LEARNT for one in past)
    if tried >= remedy.tries or (in_all >= TRIES_IN_ALL and trouble not in LEARNT):
        return None
    return remedy


def is_held_otherwise(shift_mm: float, turn_rad: float) -> bool:
    """Tell whether a measured grip is too far from the one that was planned with."""
    return shift_mm > HOLD_MM or turn_rad > HOLD_RAD


def merged(masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_] | None:
    """Return which samples any of the views (n,) has shown; None where there was none."""
    whole = [mask for mask in masks if len(mask)]
    return np.logical_or.reduce(whole) if whole else None
