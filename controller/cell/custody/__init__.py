"""Custody: the gripper, tray or table that has the part, and the gripper that may open.

`fold.py` works custody out from the rows of all runs, `known_journals.py` finds those rows,
`openings.py` reads the grippers, `start_check.py` refuses a start while a gripper may hold a part,
`trays.py` counts the parts in the trays, `releasing.py` opens a gripper for a person, and
`release_guard.py` is the only module that opens jaws in a run.
"""

from .fold import (
    CellIdentity,
    Custody,
    GripperName,
    Held,
    custody_of,
    fold_custody,
    known_words,
    read_folded,
    where_it_is,
)
from .trays import ALONE, Around, TrayRecord, left_in_trays, next_nest

__all__ = [
    "ALONE",
    "Around",
    "CellIdentity",
    "Custody",
    "GripperName",
    "Held",
    "TrayRecord",
    "custody_of",
    "fold_custody",
    "known_words",
    "left_in_trays",
    "next_nest",
    "read_folded",
    "where_it_is",
]
