"""Goes through the plan step by step; shows each start and journals its duration."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypedDict, TypeVar, Unpack

from controller.cell.journal.rows import StepDone
from controller.cell.machine import SafePoint
from controller.planning import (
    GiveStep,
    Look,
    Park,
    Pick,
    Place,
    Present,
    ReceiveStep,
    SetDown,
    Step,
)
from drivers.clock import CellClock

from .gate import Gate
from .motion import WORST_MORE_S, WORST_SHARE, Motion
from .records import BatchRecord

SomeStep = TypeVar("SomeStep", bound=Step)


# State of the cell at the end of each kind of step.
STEP_ENDS: Final[Mapping[type[Step], SafePoint]] = {
    Look: SafePoint.PARKED,
    Pick: SafePoint.LIFTED,
    Present: SafePoint.AT_VIEW,
    GiveStep: SafePoint.IN_FIXED,
    ReceiveStep: SafePoint.TAKEN_BACK,
    SetDown: SafePoint.SET_DOWN,
    Place: SafePoint.PLACED,
    Park: SafePoint.PARKED,
}
# Steps that may fail half-way, and then go back the way they came before a pause can begin.
GOING_BACK: Final = (Pick, GiveStep, ReceiveStep)


class StepFields(TypedDict, total=False):
    """The fields of a step's row beside its label and times; see `StepDone`."""

    view: str
    passed_by: str
    tray: str
    jaw_mm: float
    expected_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class PlanSteps:
    """The plan of the current part, and its next step.

    Attributes
    ----------
    record : has the plan
    motion : motion service; marks a free place after each step
    clock : times the steps [cell s]
    gate : gate, informed of the longest duration of a step, for a pause
    """

    record: BatchRecord
    motion: Motion
    clock: CellClock
    gate: Gate

    def next(self, kind: type[SomeStep]) -> SomeStep | None:
        """Return the next step if it is of this kind, None otherwise."""
        part = self.record.part
        if part.plan is None or part.next_step >= len(part.plan.steps):
            return None
        step = part.plan.steps[part.next_step]
        return step if isinstance(step, kind) else None

    def begin(self, step: Step) -> float:
        """Show that a step begins; return when [cell s]."""
        part, plan = self.record.part, self.record.part.plan
        remaining = None
        if plan is not None:
            done = sum(s.seconds for s in plan.steps[: part.next_step])
            remaining = max(0.0, plan.forecast_s - done)
        self.record.show(
            step.label,
            step=part.next_step + 1,
            step_count=len(plan.steps) + 1 if plan else 0,
            remaining_s=remaining,
        )
        ways = 2 if isinstance(step, GOING_BACK) else 1
        self.gate.begin_step(ways * WORST_SHARE * step.seconds + WORST_MORE_S)
        return self.clock.now_s()

    def end(self, step: Step, started_s: float, **more: Unpack[StepFields]) -> None:
        """Journal that a step is done; every step ends with the arm clear of everything.

        Parameters
        ----------
        step : step to describe
        started_s : start time, as `begin` returned it [cell s]
        more : further fields of its row
        """
        self.record.note(
            StepDone(
                label=step.label,
                forecast_s=round(step.seconds - step.wait_s, 2),
                seconds=round(self.clock.now_s() - started_s, 2),
                **more,
            )
        )
        self.record.part.next_step += 1
        self.motion.mark_free()
        self.motion.reach(STEP_ENDS[type(step)], ends_step=True)
