"""Custody: which gripper, tray or table has the part, and which gripper may open.

`fold.py` works custody out from the rows of all runs, `known_journals.py` finds those rows,
`openings.py` reads the grippers, `start_check.py` refuses a start while a gripper may hold a part,
`releasing.py` opens a gripper for a person, and `release_guard.py` is the only module that opens
jaws in a run.
"""

from .fold import (
    CellIdentity,
    Custody,
    GripperName,
    Held,
    fold_custody,
    read_folded,
    where_it_is,
)

__all__ = [
    "CellIdentity",
    "Custody",
    "GripperName",
    "Held",
    "fold_custody",
    "read_folded",
    "where_it_is",
]
