"""What the cell decides, without I/O: its next state, and which part faults it recovers from.

`table.py` has states, events and effects; `machine.py` decides by it; `recovery.py` is the fault
policy, `budgets.py` what a batch learns of its grasps and views; `diagram.py` draws
docs/state-machine.md.
"""

from .budgets import GRASP, VIEW, Budgets, Demotion
from .machine import CellMachine, Decision, Transition
from .recovery import (
    BACK,
    ENDS,
    LEARNT,
    PARKING,
    STILL_HELD,
    WORTH_SHARE,
    Act,
    FaultPolicy,
    PartFault,
    Recovery,
    Rung,
    decide,
    is_held_otherwise,
    next_rung,
)
from .table import (
    COMMANDS,
    ENTRY,
    EXECUTE,
    IGNORED,
    RESTING,
    SEPARATOR,
    STAGES,
    STATES,
    TABLE,
    Effect,
    Event,
)

__all__ = [
    "BACK",
    "COMMANDS",
    "ENDS",
    "ENTRY",
    "EXECUTE",
    "GRASP",
    "IGNORED",
    "LEARNT",
    "PARKING",
    "RESTING",
    "SEPARATOR",
    "STAGES",
    "STATES",
    "STILL_HELD",
    "TABLE",
    "VIEW",
    "WORTH_SHARE",
    "Act",
    "Budgets",
    "CellMachine",
    "Decision",
    "Demotion",
    "Effect",
    "Event",
    "FaultPolicy",
    "PartFault",
    "Recovery",
    "Rung",
    "Transition",
    "decide",
    "is_held_otherwise",
    "next_rung",
]
