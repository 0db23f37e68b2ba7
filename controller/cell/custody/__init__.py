"""Custody: which gripper, tray or table has the part, what a start makes of it, who may let go.

`fold.py` reads it from the rows of all runs, `known_journals.py` finds those, `openings.py` asks
the grippers, `start_check.py` refuses a start, `releasing.py` opens a gripper for a person,
`release_guard.py` is the only door through which jaws open in a run.
"""

from .fold import (
    FOLDED_EVENTS,
    FOLDED_KINDS,
    CellIdentity,
    Custody,
    GripperName,
    Held,
    fold_custody,
    where_it_is,
)

__all__ = [
    "FOLDED_EVENTS",
    "FOLDED_KINDS",
    "CellIdentity",
    "Custody",
    "GripperName",
    "Held",
    "fold_custody",
    "where_it_is",
]
