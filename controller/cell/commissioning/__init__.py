"""Commissioning: steps that measure the cell as it really stands, each with its own evidence.

`session.py` runs steps in order, `visit.py` one step from connecting to rest, `bench.py` is what a
step works with, `person.py` who answers and lends a hand, `steps/` are the steps. What a step
computes from pictures and readings is `controller.commissioning`'s, which knows no device.
"""

from .bench import Bench
from .errors import NobodyThereError, StepFailedError
from .evidence import Evidence
from .person import EmulatedPerson, Errand, Person
from .session import CommissionOrder, Session, due
from .steps import STEPS, Step, step_plans

__all__ = [
    "STEPS",
    "Bench",
    "CommissionOrder",
    "EmulatedPerson",
    "Errand",
    "Evidence",
    "NobodyThereError",
    "Person",
    "Session",
    "Step",
    "StepFailedError",
    "due",
    "step_plans",
]
