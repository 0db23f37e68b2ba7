"""Where the cell stands in the state machine of OPC 40100-1, and the ways between. No I/O.

The names are the browse names of the NodeSet (OPC 40100-1, 8.2 and 8.3); the numbers of states and
transitions are read from it.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal

from controller.plant.model import CellState


class Place(StrEnum):
    """A state of the vision system; the last four are below Operational."""

    PREOPERATIONAL = "Preoperational"
    HALTED = "Halted"
    ERROR = "Error"
    INITIALIZED = "Initialized"
    READY = "Ready"
    SINGLE = "SingleExecution"
    CONTINUOUS = "ContinuousExecution"

    @property
    def outer(self) -> str:
        """Its name in the outer machine."""
        return OPERATIONAL if self in OPERATIONAL_PLACES else self.value


OPERATIONAL: Final = "Operational"
EXECUTING: Final = (Place.SINGLE, Place.CONTINUOUS)
OPERATIONAL_PLACES: Final = (Place.INITIALIZED, Place.READY, *EXECUTING)

Cause = Literal[
    "Halt", "Reset", "PrepareRecipe", "UnprepareRecipe", "StartSingleJob", "StartContinuous",
    "Stop", "Abort",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Step:
    """A transition: its browse name in the NodeSet, and where it leads."""

    transition: str
    before: Place
    after: Place


def _steps(table: Mapping[str, tuple[tuple[Place, ...], Place]]) -> tuple[Step, ...]:
    return tuple(
        Step(name, before, after) for name, (places, after) in table.items() for before in places
    )


# OPC 40100-1, tables of 8.2.8 and 8.3.7: the transitions that the system makes by itself
BY_ITSELF: Final = _steps(
    {
        "PreoperationalToHaltedAuto": ((Place.PREOPERATIONAL,), Place.HALTED),
        "PreoperationalToErrorAuto": ((Place.PREOPERATIONAL,), Place.ERROR),
        "PreoperationalToOperationalAuto": ((Place.PREOPERATIONAL,), Place.INITIALIZED),
        "HaltedToPreoperationalAuto": ((Place.HALTED,), Place.PREOPERATIONAL),
        "ErrorToPreoperationalAuto": ((Place.ERROR,), Place.PREOPERATIONAL),
        "ErrorToHaltedAuto": ((Place.ERROR,), Place.HALTED),
        "ErrorToOperationalAuto": ((Place.ERROR,), Place.INITIALIZED),
        "OperationalToPreoperationalAuto": (OPERATIONAL_PLACES, Place.PREOPERATIONAL),
        "OperationalToHaltedAuto": (OPERATIONAL_PLACES, Place.HALTED),
        "OperationalToErrorAuto": (OPERATIONAL_PLACES, Place.ERROR),
        "InitializedToReadyAuto": ((Place.INITIALIZED,), Place.READY),
        "ReadyToInitializedAuto": ((Place.READY,), Place.INITIALIZED),
        "ReadyToSingleExecutionAuto": ((Place.READY,), Place.SINGLE),
        "ReadyToContinuousExecutionAuto": ((Place.READY,), Place.CONTINUOUS),
        "SingleExecutionToReadyAuto": ((Place.SINGLE,), Place.READY),
        "ContinuousExecutionToReadyAuto": ((Place.CONTINUOUS,), Place.READY),
    }
)

# and those that a client's method makes
BY_METHOD: Final[Mapping[Cause, tuple[Step, ...]]] = {
    "Halt": _steps(
        {
            "PreoperationalToHalted": ((Place.PREOPERATIONAL,), Place.HALTED),
            "ErrorToHalted": ((Place.ERROR,), Place.HALTED),
            "OperationalToHalted": (OPERATIONAL_PLACES, Place.HALTED),
        }
    ),
    "Reset": _steps(
        {
            "HaltedToPreoperational": ((Place.HALTED,), Place.PREOPERATIONAL),
            "ErrorToPreoperational": ((Place.ERROR,), Place.PREOPERATIONAL),
            "OperationalToPreoperational": (OPERATIONAL_PLACES, Place.PREOPERATIONAL),
        }
    ),
    "PrepareRecipe": _steps({"InitializedToReadyRecipe": ((Place.INITIALIZED,), Place.READY)}),
    "UnprepareRecipe": _steps({"ReadyToInitializedRecipe": ((Place.READY,), Place.INITIALIZED)}),
    "StartSingleJob": _steps({"ReadyToSingleExecution": ((Place.READY,), Place.SINGLE)}),
    "StartContinuous": _steps({"ReadyToContinuousExecution": ((Place.READY,), Place.CONTINUOUS)}),
    "Stop": _steps(
        {
            "SingleExecutionToReadyStop": ((Place.SINGLE,), Place.READY),
            "ContinuousExecutionToReadyStop": ((Place.CONTINUOUS,), Place.READY),
        }
    ),
    "Abort": _steps(
        {
            "SingleExecutionToReadyAbort": ((Place.SINGLE,), Place.READY),
            "ContinuousExecutionToReadyAbort": ((Place.CONTINUOUS,), Place.READY),
        }
    ),
}


def step_of(cause: Cause, at: Place) -> Step | None:
    """Return the transition that a method makes in a state; None where it makes none."""
    return next((step for step in BY_METHOD[cause] if step.before is at), None)


def way(at: Place, to: Place) -> tuple[Step, ...]:
    """Return the fewest transitions that the system makes by itself from a state to another.

    Raises
    ------
    ValueError : there is none; the table has one for each pair
    """
    ways: deque[tuple[Place, tuple[Step, ...]]] = deque([(at, ())])
    seen = {at}
    while ways:
        place, steps = ways.popleft()
        if place is to:
            return steps
        for step in BY_ITSELF:
            if step.before is place and step.after not in seen:
                seen.add(step.after)
                ways.append((step.after, (*steps, step)))
    raise ValueError(f"no way from {at} to {to}")


JobKind = Literal["single", "continuous"]
OF_KIND: Final[Mapping[JobKind, Place]] = {"single": Place.SINGLE, "continuous": Place.CONTINUOUS}


@dataclass(frozen=True, slots=True)
class Intent:
    """What clients have asked for and the cell does not know of.

    Attributes
    ----------
    is_prepared : a recipe is prepared
    is_halted : a client has halted the starts
    order, kind : number and kind of a job that was accepted and is not over; None without
    has_begun : the job waits for no person's release, and its run is not there yet
    """

    is_prepared: bool = False
    is_halted: bool = False
    order: str | None = None
    kind: JobKind | None = None
    has_begun: bool = False


def place_of(cell: CellState, intent: Intent, now: Place) -> Place:
    """Return the state in which the vision system is to be.

    Parameters
    ----------
    cell : state of the cell
    intent : what clients have asked for
    now : where it is; kept while the cell does not tell yet how many parts a run is for
    """
    if cell.state == "unknown":
        return Place.PREOPERATIONAL
    if intent.is_halted or cell.state == "taken":
        return Place.HALTED
    if cell.state == "left" or cell.packml in ("Aborting", "Aborted", "Clearing"):
        return Place.ERROR
    if intent.has_begun and intent.kind is not None and cell.run is None:
        return OF_KIND[intent.kind]
    if cell.packml in ("Stopping", "Complete"):
        return Place.READY
    if cell.state == "stopped":  # a run begins in this state, too, before its first part
        return now if now in EXECUTING and not cell.part else Place.READY
    if cell.run is not None or cell.state == "starting":
        return _executing(cell, intent, now)
    return Place.READY if intent.is_prepared else Place.INITIALIZED


def _executing(cell: CellState, intent: Intent, now: Place) -> Place:
    if now in EXECUTING:
        return now
    is_ours = cell.order == intent.order or (cell.order is None and intent.has_begun)
    if intent.kind is not None and is_ours:
        return OF_KIND[intent.kind]
    ordered = sum(count for _, count in cell.done.values())
    if not ordered:
        return now if now in OPERATIONAL_PLACES else Place.READY
    return Place.SINGLE if ordered == 1 else Place.CONTINUOUS


ItemWord = Literal["NotAvailable", "OutOfService", "NotExecuting", "Executing"]


def item_word(cell: CellState) -> ItemWord:
    """Return the state of the machine by OPC 40001-1, 12.2."""
    if cell.state == "unknown":
        return "NotAvailable"
    if cell.state in ("left", "taken") or cell.packml in ("Aborting", "Aborted", "Clearing"):
        return "OutOfService"
    if cell.packml in ("Execute", "Completing", "Resetting", "Starting", "Idle") and (
        cell.run is not None or cell.state == "starting"
    ):
        return "Executing"
    return "NotExecuting"


class SystemState(StrEnum):
    """SEMI E10's six states, OPC 40100-1, 12.22; the names of the NodeSet."""

    PRODUCTIVE = "PRD_1"
    STANDBY = "SBY_2"
    ENGINEERING = "ENG_3"
    SCHEDULED_DOWN = "SDT_4"
    UNSCHEDULED_DOWN = "UDT_5"
    NON_SCHEDULED = "NST_6"


def system_state(cell: CellState, place: Place) -> tuple[SystemState, str]:
    """Return how the time of the cell counts by SEMI E10, and why, as a sentence."""
    said = cell.question.text if cell.question else cell.message
    if place is Place.PREOPERATIONAL:
        return SystemState.NON_SCHEDULED, said or "the cell does not answer"
    if cell.state == "taken":
        return SystemState.ENGINEERING, said or "another command has the cell"
    if place is Place.ERROR or cell.packml in ("Holding", "Held"):
        return SystemState.UNSCHEDULED_DOWN, said or cell.state
    if place is Place.HALTED:
        return SystemState.SCHEDULED_DOWN, said or "halted by a client until Reset"
    if place in EXECUTING and cell.packml not in ("Suspending", "Suspended", "Unsuspending"):
        return SystemState.PRODUCTIVE, said or cell.state
    return SystemState.STANDBY, said or cell.state
