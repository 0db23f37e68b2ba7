"""Going on after a crash: the possible states, the actual one, and the way on.

`interrupted.py` and `trail.py` fold the journal of the interrupted run, `world.py` reads the
devices without moving any, `classify.py` finds the case, `propose.py` the permitted ways to
continue, `homing.py` checks if an arm without positions may home with the part, `beside.py` if one
beside its path may go back to it. Nothing here moves anything; `controller.cell.actions.recover`
carries out the accepted proposal.
"""

from .beside import Back, Beside, beside_path
from .classify import Case, Opens, WayOut, classify
from .homing import HomingBounds, HomingWithPart, Sweep, lost_bounds, why_not_home
from .interrupted import Interrupted, TakenView, fold_interrupted, same_cell
from .propose import FIRST_SPEED, Proposal, arm_open_mm, listed, propose
from .trail import Leaving, Trail
from .world import Jaws, World, read_world

__all__ = [
    "FIRST_SPEED",
    "Back",
    "Beside",
    "Case",
    "HomingBounds",
    "HomingWithPart",
    "Interrupted",
    "Jaws",
    "Leaving",
    "Opens",
    "Proposal",
    "Sweep",
    "TakenView",
    "Trail",
    "WayOut",
    "World",
    "arm_open_mm",
    "beside_path",
    "classify",
    "fold_interrupted",
    "listed",
    "lost_bounds",
    "propose",
    "read_world",
    "same_cell",
    "why_not_home",
]
