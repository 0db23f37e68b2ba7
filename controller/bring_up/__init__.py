"""Guided commissioning: steps that measure the cell as built, each with its own evidence.

`session.py` runs steps in order, `visit.py` one step from connecting to rest, `bench.py` has the
tools of a step, `person.py` the helper who answers, `steps/` are the steps. `procedure/` keeps what
a step leaves, `evidence_page/` makes a page of it, `target_sheet/` prints boards. Computations on
pictures and readings are in `controller.calibration`, which knows no device.
"""

from .bench import Bench
from .errors import NobodyThereError, StepFailedError
from .evidence import StepEvidence
from .person import EmulatedPerson, Errand, Person
from .session import CommissioningSession, CommissionOrder, due
from .steps import STEPS, CommissioningStep, step_plans

__all__ = [
    "STEPS",
    "Bench",
    "CommissionOrder",
    "CommissioningSession",
    "CommissioningStep",
    "EmulatedPerson",
    "Errand",
    "NobodyThereError",
    "Person",
    "StepEvidence",
    "StepFailedError",
    "due",
    "step_plans",
]
