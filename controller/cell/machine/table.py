"""The table of the cell: states, events, and the effect of entering each state.

States carry PackML's names; within Execute stand the stages of one part. A pair of state and event
that is neither in `TABLE` nor in `IGNORED` is refused.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final


class Event(StrEnum):
    """What can happen to the cell; the value is its name in the journal."""

    RESET = "reset"
    RESET_DONE = "reset_done"
    START = "start"
    PICTURE_TAKEN = "picture_taken"
    PART_RECOGNISED = "part_recognised"
    PLANNED = "planned"
    PLANNED_ON = "planned_on"
    GRASPED = "grasped"
    GRASP_MISSED = "grip_missed"
    SHOWN = "shown"
    INSPECTED = "inspected"
    HAND_OFF_DUE = "hand_off_due"
    HANDED_OFF = "handed_off"
    SET_DOWN_DUE = "set_down_due"
    SET_DOWN = "set_down"
    PART_DROPPED = "part_dropped"
    PART_NOT_SEEN = "part_not_seen"
    WITHDRAWN = "withdrawn"
    PLAN_VOID = "plan_void"
    ALL_SEEN = "all_seen"
    PLACED = "placed"
    PART_DONE = "part_done"
    BATCH_DONE = "batch_done"
    PART_PROBLEM = "part_problem"
    HOLD_DONE = "hold_done"
    STOP = "stop"
    STOP_DONE = "stop_done"
    FAULT = "fault"
    ABORT_DONE = "abort_done"
    CLEAR = "clear"
    CLEAR_DONE = "clear_done"


class Effect(StrEnum):
    """What the dispatcher is to start."""

    HOME = "home"
    ACQUIRE = "acquire"
    RECOGNISE = "recognise"
    PLAN = "plan"
    GRASP = "grasp"
    PRESENT = "present"
    INSPECT = "inspect"
    HAND_OFF = "hand_off"
    SET_DOWN = "set_down"
    WITHDRAW = "withdraw"
    PLACE = "place"
    COMPLETE = "complete"
    HOLD = "hold"
    STOP_MOTION = "stop_motion"
    ABORT_MOTION = "abort_motion"
    CLEAR_FAULT = "clear_fault"


SEPARATOR: Final = "_"
EXECUTE: Final = "execute"

# The effect of entering a stage.
STAGES: Final[Mapping[str, Effect]] = {
    "acquiring": Effect.ACQUIRE,
    "recognising": Effect.RECOGNISE,
    "planning": Effect.PLAN,
    "grasping": Effect.GRASP,
    "presenting": Effect.PRESENT,
    "inspecting": Effect.INSPECT,
    "handing": Effect.HAND_OFF,
    "lowering": Effect.SET_DOWN,
    "withdrawing": Effect.WITHDRAW,
    "placing": Effect.PLACE,
}
ENTRY: Final[Mapping[str, Effect]] = {
    "resetting": Effect.HOME,
    "completing": Effect.COMPLETE,
    "holding": Effect.HOLD,
    "stopping": Effect.STOP_MOTION,
    "aborting": Effect.ABORT_MOTION,
    "clearing": Effect.CLEAR_FAULT,
    **{f"{EXECUTE}{SEPARATOR}{stage}": effect for stage, effect in STAGES.items()},
}
RESTING: Final = ("stopped", "idle", "complete", "held", "aborted")
STATES: Final = (
    *RESTING,
    *(s for s in ENTRY if not s.startswith(EXECUTE)),
    *(s for s in ENTRY if s.startswith(EXECUTE)),
)


def state_of_stage(name: str) -> str:
    """Return the state in which a stage of a part is worked on."""
    return f"{EXECUTE}{SEPARATOR}{name}"


_IN_EXECUTE: Final = tuple(state_of_stage(name) for name in STAGES)
# Stages in which a gripper has the part, or is about to take it.
_HOLDING: Final = tuple(
    state_of_stage(name)
    for name in ("planning", "grasping", "presenting", "inspecting", "handing", "lowering",
                 "placing")
)  # fmt: skip
# Stop is taken wherever something may move; in `held` too, where the arm may hold a part.
_STOPPABLE: Final = ("resetting", "completing", "holding", "held", "idle", *_IN_EXECUTE)
# A fault is taken even at rest: an open door or a lost device is reported at once.
_FAULTABLE: Final = (*_STOPPABLE, "stopping", "clearing")

TABLE: Final[tuple[tuple[Event, tuple[str, ...], str], ...]] = (
    (Event.RESET, ("stopped", "complete", "held"), "resetting"),
    (Event.RESET_DONE, ("resetting",), "idle"),
    (Event.START, ("idle",), state_of_stage("acquiring")),
    (Event.PICTURE_TAKEN, (state_of_stage("acquiring"),), state_of_stage("recognising")),
    (Event.PART_RECOGNISED, (state_of_stage("recognising"),), state_of_stage("planning")),
    (Event.PLANNED, (state_of_stage("planning"),), state_of_stage("grasping")),
    # The plan was made while a gripper has the part.
    (Event.PLANNED_ON, (state_of_stage("planning"),), state_of_stage("presenting")),
    (Event.GRASPED, (state_of_stage("grasping"),), state_of_stage("presenting")),
    # A missed grasp may have pushed the part: take pictures before the next one.
    (Event.GRASP_MISSED, (state_of_stage("grasping"),), state_of_stage("acquiring")),
    (Event.SHOWN, (state_of_stage("presenting"),), state_of_stage("inspecting")),
    (Event.INSPECTED, (state_of_stage("inspecting"),), state_of_stage("presenting")),
    (Event.HAND_OFF_DUE, (state_of_stage("inspecting"),), state_of_stage("handing")),
    (Event.HANDED_OFF, (state_of_stage("handing"),), state_of_stage("presenting")),
    (Event.SET_DOWN_DUE, (state_of_stage("inspecting"),), state_of_stage("lowering")),
    (Event.SET_DOWN, (state_of_stage("lowering"),), state_of_stage("withdrawing")),
    # No gripper has the part: withdraw the arm, take pictures, plan from where the part is.
    (Event.PART_DROPPED, _HOLDING, state_of_stage("withdrawing")),
    # In these states no gripper should have a part: a person took it, or custody is wrong.
    (Event.PART_DROPPED, ("resetting", "completing"), "holding"),
    (Event.WITHDRAWN, (state_of_stage("withdrawing"),), state_of_stage("acquiring")),
    # A part that was lost may still be rolling: pictures again before anybody is called.
    (Event.PART_NOT_SEEN, (state_of_stage("recognising"),), state_of_stage("acquiring")),
    # The part is held otherwise than planned, or less of it was in sight than planned.
    (
        Event.PLAN_VOID,
        (state_of_stage("presenting"), state_of_stage("inspecting"), state_of_stage("handing")),
        state_of_stage("planning"),
    ),
    (Event.ALL_SEEN, (state_of_stage("inspecting"),), state_of_stage("placing")),
    (Event.PLACED, (state_of_stage("placing"),), "completing"),
    (Event.PART_DONE, ("completing",), state_of_stage("acquiring")),
    (Event.BATCH_DONE, ("completing",), "complete"),
    # Something is wrong with the part, not the cell: hold for a person. Homing may find a part in
    # the fixed gripper, and one may slip out of it until the batch is complete.
    (Event.PART_PROBLEM, ("resetting", "completing", *_IN_EXECUTE), "holding"),
    (Event.HOLD_DONE, ("holding",), "held"),
    (Event.STOP, _STOPPABLE, "stopping"),
    (Event.STOP_DONE, ("stopping",), "stopped"),
    (Event.FAULT, (*_FAULTABLE, "stopped", "complete"), "aborting"),
    (Event.ABORT_DONE, ("aborting",), "aborted"),
    (Event.CLEAR, ("aborted",), "clearing"),
    (Event.CLEAR_DONE, ("clearing",), "stopped"),
)

# Sent by people and interlocks; all other events are outcomes of effects.
COMMANDS: Final = (Event.RESET, Event.START, Event.STOP, Event.CLEAR, Event.FAULT)
_OUTCOMES: Final = tuple(event for event in Event if event not in COMMANDS)
# States entered by overtaking an effect, with the outcome that is awaited in them.
_OVERTAKEN: Final[Mapping[str, Event | None]] = {
    "stopping": Event.STOP_DONE,
    "stopped": None,
    "aborting": Event.ABORT_DONE,
    "aborted": None,
    "holding": Event.HOLD_DONE,
    "held": None,
    "clearing": Event.CLEAR_DONE,
}

# Pairs that are expected and change nothing: events, states, reason.
IGNORED: Final[tuple[tuple[tuple[Event, ...], tuple[str, ...], str], ...]] = (
    (
        (Event.FAULT,),
        ("aborting", "aborted"),
        "already aborting: the first fault is the one on record",
    ),
    (
        (Event.STOP,),
        ("stopped", "stopping", "aborting", "aborted", "complete", "clearing"),
        "nothing moves any more",
    ),
    # The fixed gripper may report late what the arm gripper has already found.
    (
        (Event.PART_DROPPED,),
        tuple(state_of_stage(name) for name in ("acquiring", "recognising", "withdrawing")),
        "nobody holds the part: it is being looked for already",
    ),
    *(
        (
            tuple(event for event in _OUTCOMES if event is not awaited),
            (state,),
            "outcome of a task that was stopped",
        )
        for state, awaited in _OVERTAKEN.items()
    ),
)
