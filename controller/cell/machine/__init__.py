"""What the cell decides, without I/O: its next state, and which part faults it recovers from.

`table.py` has states, events and effects; `machine.py` decides by it; `recovery.py` is the recovery
policy; `diagram.py` draws docs/state-machine.md.
"""

from .machine import CellMachine, Decision, Transition
from .recovery import (
    LEARNT,
    RECOVERY_ACTIONS,
    TRIES_IN_ALL,
    TRIES_PER_KIND,
    WORTH_SHARE,
    PartFault,
    Recovery,
    RecoveryAction,
    is_held_otherwise,
    recovery_for,
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
    "COMMANDS",
    "ENTRY",
    "EXECUTE",
    "IGNORED",
    "LEARNT",
    "RECOVERY_ACTIONS",
    "RESTING",
    "SEPARATOR",
    "STAGES",
    "STATES",
    "TABLE",
    "TRIES_IN_ALL",
    "TRIES_PER_KIND",
    "WORTH_SHARE",
    "CellMachine",
    "Decision",
    "Effect",
    "Event",
    "PartFault",
    "Recovery",
    "RecoveryAction",
    "Transition",
    "is_held_otherwise",
    "recovery_for",
]
