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


class VisionState(StrEnum):
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
        return OPERATIONAL if self in OPERATIONAL_STATES else self.value


OPERATIONAL: Final = "Operational"
EXECUTING: Final = (VisionState.SINGLE, VisionState.CONTINUOUS)
OPERATIONAL_STATES: Final = (VisionState.INITIALIZED, VisionState.READY, *EXECUTING)

Cause = Literal[
    "Halt", "Reset", "PrepareRecipe", "UnprepareRecipe", "StartSingleJob", "StartContinuous",
    "Stop", "Abort",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class VisionTransition:
    """A transition: its browse name in the NodeSet, and where it leads."""

    name: str
    before: VisionState
    after: VisionState


def _transitions(
    table: Mapping[str, tuple[tuple[VisionState, ...], VisionState]],
) -> tuple[VisionTransition, ...]:
    return tuple(
        VisionTransition(name, before, after)
        for name, (vision_states, after) in table.items()
        for before in vision_states
    )


# OPC 40100-1, tables of 8.2.8 and 8.3.7: the transitions that the system makes by itself
BY_ITSELF: Final = _transitions(
    {
        "PreoperationalToHaltedAuto": ((VisionState.PREOPERATIONAL,), VisionState.HALTED),
        "PreoperationalToErrorAuto": ((VisionState.PREOPERATIONAL,), VisionState.ERROR),
        "PreoperationalToOperationalAuto": ((VisionState.PREOPERATIONAL,), VisionState.INITIALIZED),
        "HaltedToPreoperationalAuto": ((VisionState.HALTED,), VisionState.PREOPERATIONAL),
        "ErrorToPreoperationalAuto": ((VisionState.ERROR,), VisionState.PREOPERATIONAL),
        "ErrorToHaltedAuto": ((VisionState.ERROR,), VisionState.HALTED),
        "ErrorToOperationalAuto": ((VisionState.ERROR,), VisionState.INITIALIZED),
        "OperationalToPreoperationalAuto": (OPERATIONAL_STATES, VisionState.PREOPERATIONAL),
        "OperationalToHaltedAuto": (OPERATIONAL_STATES, VisionState.HALTED),
        "OperationalToErrorAuto": (OPERATIONAL_STATES, VisionState.ERROR),
        "InitializedToReadyAuto": ((VisionState.INITIALIZED,), VisionState.READY),
        "ReadyToInitializedAuto": ((VisionState.READY,), VisionState.INITIALIZED),
        "ReadyToSingleExecutionAuto": ((VisionState.READY,), VisionState.SINGLE),
        "ReadyToContinuousExecutionAuto": ((VisionState.READY,), VisionState.CONTINUOUS),
        "SingleExecutionToReadyAuto": ((VisionState.SINGLE,), VisionState.READY),
        "ContinuousExecutionToReadyAuto": ((VisionState.CONTINUOUS,), VisionState.READY),
    }
)

# and those that a client's method makes
BY_METHOD: Final[Mapping[Cause, tuple[VisionTransition, ...]]] = {
    "Halt": _transitions(
        {
            "PreoperationalToHalted": ((VisionState.PREOPERATIONAL,), VisionState.HALTED),
            "ErrorToHalted": ((VisionState.ERROR,), VisionState.HALTED),
            "OperationalToHalted": (OPERATIONAL_STATES, VisionState.HALTED),
        }
    ),
    "Reset": _transitions(
        {
            "HaltedToPreoperational": ((VisionState.HALTED,), VisionState.PREOPERATIONAL),
            "ErrorToPreoperational": ((VisionState.ERROR,), VisionState.PREOPERATIONAL),
            "OperationalToPreoperational": (OPERATIONAL_STATES, VisionState.PREOPERATIONAL),
        }
    ),
    "PrepareRecipe": _transitions(
        {"InitializedToReadyRecipe": ((VisionState.INITIALIZED,), VisionState.READY)}
    ),
    "UnprepareRecipe": _transitions(
        {"ReadyToInitializedRecipe": ((VisionState.READY,), VisionState.INITIALIZED)}
    ),
    "StartSingleJob": _transitions(
        {"ReadyToSingleExecution": ((VisionState.READY,), VisionState.SINGLE)}
    ),
    "StartContinuous": _transitions(
        {"ReadyToContinuousExecution": ((VisionState.READY,), VisionState.CONTINUOUS)}
    ),
    "Stop": _transitions(
        {
            "SingleExecutionToReadyStop": ((VisionState.SINGLE,), VisionState.READY),
            "ContinuousExecutionToReadyStop": ((VisionState.CONTINUOUS,), VisionState.READY),
        }
    ),
    "Abort": _transitions(
        {
            "SingleExecutionToReadyAbort": ((VisionState.SINGLE,), VisionState.READY),
            "ContinuousExecutionToReadyAbort": ((VisionState.CONTINUOUS,), VisionState.READY),
        }
    ),
}


def transition_of(cause: Cause, at: VisionState) -> VisionTransition | None:
    """Return the transition that a method makes in a state; None where it makes none."""
    return next((transition for transition in BY_METHOD[cause] if transition.before is at), None)


def transitions_between(at: VisionState, to: VisionState) -> tuple[VisionTransition, ...]:
    """Return the fewest transitions that the system makes by itself from a state to another.

    Raises
    ------
    ValueError : there is none; the table has one for each pair
    """
    ways: deque[tuple[VisionState, tuple[VisionTransition, ...]]] = deque([(at, ())])
    seen = {at}
    while ways:
        vision_state, transitions = ways.popleft()
        if vision_state is to:
            return transitions
        for transition in BY_ITSELF:
            if transition.before is vision_state and transition.after not in seen:
                seen.add(transition.after)
                ways.append((transition.after, (*transitions, transition)))
    raise ValueError(f"no way from {at} to {to}")


JobKind = Literal["single", "continuous"]
OF_KIND: Final[Mapping[JobKind, VisionState]] = {
    "single": VisionState.SINGLE,
    "continuous": VisionState.CONTINUOUS,
}


@dataclass(frozen=True, slots=True)
class ClientRequest:
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


def vision_state_of(cell: CellState, request: ClientRequest, now: VisionState) -> VisionState:
    """Return the state in which the vision system is to be.

    Parameters
    ----------
    cell : state of the cell
    request : what clients have asked for
    now : where it is; kept while the cell does not tell yet how many parts a run is for
    """
    if cell.state == "unknown":
        return VisionState.PREOPERATIONAL
    if request.is_halted or cell.state == "taken":
        return VisionState.HALTED
    if cell.state == "left" or cell.packml in ("Aborting", "Aborted", "Clearing"):
        return VisionState.ERROR
    if request.has_begun and request.kind is not None and cell.run is None:
        return OF_KIND[request.kind]
    if cell.packml in ("Stopping", "Complete"):
        return VisionState.READY
    if cell.state == "stopped":  # a run begins in this state, too, before its first part
        return now if now in EXECUTING and not cell.part else VisionState.READY
    if cell.run is not None or cell.state == "starting":
        return _executing(cell, request, now)
    return VisionState.READY if request.is_prepared else VisionState.INITIALIZED


def _executing(cell: CellState, request: ClientRequest, now: VisionState) -> VisionState:
    if now in EXECUTING:
        return now
    is_ours = cell.order == request.order or (cell.order is None and request.has_begun)
    if request.kind is not None and is_ours:
        return OF_KIND[request.kind]
    ordered = sum(count for _, count in cell.done.values())
    if not ordered:
        return now if now in OPERATIONAL_STATES else VisionState.READY
    return VisionState.SINGLE if ordered == 1 else VisionState.CONTINUOUS


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


def system_state(cell: CellState, vision_state: VisionState) -> tuple[SystemState, str]:
    """Return how the time of the cell counts by SEMI E10, and why, as a sentence."""
    said = cell.question.text if cell.question else cell.message
    if vision_state is VisionState.PREOPERATIONAL:
        return SystemState.NON_SCHEDULED, said or "the cell does not answer"
    if cell.state == "taken":
        return SystemState.ENGINEERING, said or "another command has the cell"
    if vision_state is VisionState.ERROR or cell.packml in ("Holding", "Held"):
        return SystemState.UNSCHEDULED_DOWN, said or cell.state
    if vision_state is VisionState.HALTED:
        return SystemState.SCHEDULED_DOWN, said or "halted by a client until Reset"
    if vision_state in EXECUTING and cell.packml not in ("Suspending", "Suspended", "Unsuspending"):
        return SystemState.PRODUCTIVE, said or cell.state
    return SystemState.STANDBY, said or cell.state
