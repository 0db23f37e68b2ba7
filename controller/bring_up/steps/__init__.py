"""The steps of commissioning, each a module independent of the others."""

from typing import Final

from ..procedure import StepPlan
from .arm import ArmStep
from .devices import DevicesStep
from .grippers import GrippersStep
from .light import LightStep
from .reach import ReachStep
from .step import CommissioningStep
from .trays import TraysStep
from .verify import VerifyStep

# Each after those that it needs.
STEPS: Final[tuple[CommissioningStep, ...]] = (
    DevicesStep(),
    LightStep(),
    ArmStep(),
    GrippersStep(),
    TraysStep(),
    ReachStep(),
    VerifyStep(),
)


def step_plans() -> tuple[StepPlan, ...]:
    """Return the order and the age of all steps."""
    return tuple(StepPlan(step.name, step.needs, step.valid_days) for step in STEPS)


__all__ = ["STEPS", "CommissioningStep", "step_plans"]
