"""A free turn in the form of files and journal, and back."""

from math import degrees

import numpy as np

from controller.config.view_set import SetTurn
from controller.recognition import FreeTurn


def turn_section(free: FreeTurn | None) -> SetTurn | None:
    """Return a free turn as a set of views and the journal state it; None for none."""
    if free is None:
        return None
    (ax, ay, az), (x, y, z) = free.axis.tolist(), free.through_mm.tolist()
    return SetTurn(
        axis=(ax, ay, az),
        through_mm=(x, y, z),
        same_deg=tuple(degrees(turn) for turn in free.same_rad.tolist()),
        is_shown=free.is_shown,
        guess_number=free.guess_number,
    )


def free_turn_of(turn: SetTurn | None) -> FreeTurn | None:
    """Return the free turn that a set of views or the journal states; None for none."""
    if turn is None:
        return None
    axis, through_mm = np.array(turn.axis), np.array(turn.through_mm)
    same_rad = np.radians(turn.same_deg)
    return FreeTurn(axis, through_mm, same_rad, turn.is_shown, turn.guess_number)
