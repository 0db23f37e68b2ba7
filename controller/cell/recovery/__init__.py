"""Going on after a crash: what may be so, what is so, and what may be done about it.

`interrupted.py` and `trail.py` fold the journal of the run that was interrupted, `world.py` asks
the devices without moving any, `classify.py` decides what is so, `propose.py` what the cell may do.
Nothing here moves anything; `controller.cell.actions.recover` does what was accepted.
"""

from .classify import Case, Leaves, Opens, classify
from .interrupted import Interrupted, TakenView, fold_interrupted, same_cell
from .propose import FIRST_SPEED, Proposal, arm_open_mm, listed, propose
from .trail import Leaving, Trail
from .world import Jaws, World, read_world

__all__ = [
    "FIRST_SPEED",
    "Case",
    "Interrupted",
    "Jaws",
    "Leaves",
    "Leaving",
    "Opens",
    "Proposal",
    "TakenView",
    "Trail",
    "World",
    "arm_open_mm",
    "classify",
    "fold_interrupted",
    "listed",
    "propose",
    "read_world",
    "same_cell",
]
