"""The table of the cell: states, events, and the effects that a transition sets going.

States carry PackML's names; Execute contains the stages of one part. A pause keeps the stage: each
piece of work has a state in every mode, and an effect begins when its stage is entered, not when a
pause ends (ADR 38). A pair of state and event that is neither in `TABLE` nor in `IGNORED` is
refused.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from messages import key


class Event(StrEnum):
    """An event of the cell; the value is its name in the journal."""

    RESET = key("reset")
    RESET_DONE = "reset_done"
    START = key("start")
    RECOVER = key("recover")
    PICTURE_TAKEN = "picture_taken"
    PART_RECOGNISED = "part_recognised"
    PLANNED = "planned"
    PLANNED_ON = "planned_on"
    GRASPED = "grasped"
    GRASP_MISSED = key("grip_missed")
    SHOWN = "shown"
    INSPECTED = "inspected"
    HAND_OFF_DUE = "hand_off_due"
    HANDED_OFF = "handed_off"
    SET_DOWN_DUE = "set_down_due"
    SET_DOWN = "set_down"
    PART_DROPPED = "part_dropped"
    PART_NOT_SEEN = key("part_not_seen")
    WITHDRAWN = "withdrawn"
    PLAN_VOID = "plan_void"
    ALL_SEEN = "all_seen"
    PLACED = key("placed")
    PART_DONE = "part_done"
    BATCH_DONE = "batch_done"
    PART_PROBLEM = "part_problem"
    HOLD_DONE = "hold_done"
    UNATTENDED = "unattended"
    LOOK_AGAIN = "look_again"
    PART_TAKEN_OUT = "part_taken_out"
    PAUSE_AFTER_STEP = key("pause_after_step")
    PAUSE_AT_SAFE_POINT = key("pause_at_safe_point")
    PAUSE_NOW = key("pause_now")
    PAUSED = "paused"
    RESUME = key("resume")
    RESUMED = "resumed"
    STEP = key("step")
    STEP_BEGUN = "step_begun"
    GUARD_OPENED = "guard_opened"
    ACKNOWLEDGE = "acknowledge"
    NOT_PROVEN = key("not_proven")
    STOP = key("stop")
    STOP_DONE = "stop_done"
    FAULT = "fault"
    ABORT_DONE = "abort_done"
    CLEAR = key("clear")
    CLEAR_DONE = "clear_done"


class Effect(StrEnum):
    """A task that the dispatcher is to start."""

    HOME = "home"
    RECOVER = key("recover")
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
    COMPLETE = key("complete")
    HOLD = key("hold")
    CONSULT = "consult"
    SUSPEND = "suspend"
    UNSUSPEND = "unsuspend"
    STOP_MOTION = "stop_motion"
    ABORT_MOTION = "abort_motion"
    CLEAR_FAULT = "clear_fault"


SEPARATOR: Final = "_"
EXECUTE: Final = "execute"

# The effect of entering a stage.
STAGES: Final[Mapping[str, Effect]] = {
    "recovering": Effect.RECOVER,
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
COMPLETING: Final = "completing"
RESETTING: Final = "resetting"


class Mode(StrEnum):
    """Whether the work goes on; the value begins the names of its states."""

    EXECUTE = EXECUTE
    SUSPENDING = "suspending"
    SUSPENDED = "suspended"
    UNSUSPENDING = "unsuspending"


# Work that can be paused, and the effect of entering it.
WORK: Final[Mapping[str, Effect]] = {
    RESETTING: Effect.HOME, **STAGES, COMPLETING: Effect.COMPLETE,
}  # fmt: skip
# PackML's own states beside Execute
_BESIDE_EXECUTE: Final = (RESETTING, COMPLETING)


def state_of(work: str, mode: Mode = Mode.EXECUTE) -> str:
    """Return the state in which a piece of work is done, or is paused."""
    if mode is Mode.EXECUTE and work in _BESIDE_EXECUTE:
        return work
    return f"{mode}{SEPARATOR}{work}"


_WORK_STATES: Final = {state_of(work, mode): (mode, work) for mode in Mode for work in WORK}


def mode_of(state: str) -> Mode | None:
    """Return the mode of a state: work goes on or is paused; None outside of work."""
    return _WORK_STATES[state][0] if state in _WORK_STATES else None


def work_of(state: str) -> str | None:
    """Return the piece of work of a state; None outside of work."""
    return _WORK_STATES[state][1] if state in _WORK_STATES else None


# The effect of entering a state that is no work.
ENTRY: Final[Mapping[str, Effect]] = {
    "holding": Effect.HOLD,
    "held": Effect.CONSULT,
    "stopping": Effect.STOP_MOTION,
    "aborting": Effect.ABORT_MOTION,
    "clearing": Effect.CLEAR_FAULT,
}
# The effect of changing to a mode.
MODE_EFFECTS: Final[Mapping[Mode, Effect]] = {
    Mode.SUSPENDING: Effect.SUSPEND,
    Mode.UNSUSPENDING: Effect.UNSUSPEND,
}
PAUSE_EFFECTS: Final = frozenset(MODE_EFFECTS.values())
_SUSPENDED: Final = tuple(state_of(work, Mode.SUSPENDED) for work in WORK)
# Where nothing moves until a person decides.
RESTING: Final = ("stopped", "idle", "complete", "held", "aborted", *_SUSPENDED)
STATES: Final = (
    "stopped", "idle", "complete", "aborted", *ENTRY,
    *(state_of(work, mode) for mode in Mode for work in WORK),
)  # fmt: skip


def effects_between(source: str, target: str) -> tuple[Effect, ...]:
    """Return the effects of a transition: the work it begins, then those of its pause."""
    if source == target:
        return ()
    found = [ENTRY[target]] if target in ENTRY else []
    mode, work = mode_of(target), work_of(target)
    if work is not None and work != work_of(source):
        found.append(WORK[work])
    if mode is not None and mode is not mode_of(source) and mode in MODE_EFFECTS:
        found.append(MODE_EFFECTS[mode])
    return tuple(found)


PAUSES: Final = (Event.PAUSE_AFTER_STEP, Event.PAUSE_AT_SAFE_POINT, Event.PAUSE_NOW)
_RUNNING: Final = (Mode.EXECUTE, Mode.SUSPENDING)
_WORKING: Final = tuple(state_of(work) for work in WORK)
_SUSPENDING: Final = tuple(state_of(work, Mode.SUSPENDING) for work in WORK)
_UNSUSPENDING: Final = tuple(state_of(work, Mode.UNSUSPENDING) for work in WORK)
_RESETTING: Final = {mode: state_of(RESETTING, mode) for mode in Mode}
_ANY_WORK: Final = tuple(_WORK_STATES)
# Stages in which a gripper has the part, or is about to take it.
_HOLDING: Final = (
    "recovering", "planning", "grasping", "presenting", "inspecting", "handing", "lowering",
    "placing",
)  # fmt: skip
# Stages in which no gripper has the part.
_LOOKING: Final = ("acquiring", "recognising", "withdrawing")
# Stop is taken wherever something may move; in `held` and `suspended` too, where the arm may hold a
# part.
_STOPPABLE: Final = ("holding", "held", "idle", *_ANY_WORK)
# A fault is taken even at rest: an open door or a lost device is reported at once.
_FAULTABLE: Final = (*_STOPPABLE, "stopping", "clearing")

# Order of the pieces of work: event, from, to. It holds in every mode: work that ends while the
# cell pauses has ended, and the work after it waits before it moves anything.
WORK_TABLE: Final[tuple[tuple[Event, tuple[str, ...], str], ...]] = (
    (Event.PICTURE_TAKEN, ("acquiring",), "recognising"),
    (Event.PART_RECOGNISED, ("recognising",), "planning"),
    (Event.PLANNED, ("planning",), "grasping"),
    # The plan was made while a gripper has the part.
    (Event.PLANNED_ON, ("planning",), "presenting"),
    (Event.GRASPED, ("grasping",), "presenting"),
    # A missed grasp may have pushed the part: take pictures before the next one.
    (Event.GRASP_MISSED, ("grasping",), "acquiring"),
    (Event.SHOWN, ("presenting",), "inspecting"),
    (Event.INSPECTED, ("inspecting",), "presenting"),
    (Event.HAND_OFF_DUE, ("inspecting",), "handing"),
    (Event.HANDED_OFF, ("handing",), "presenting"),
    (Event.SET_DOWN_DUE, ("inspecting",), "lowering"),
    (Event.SET_DOWN, ("lowering",), "withdrawing"),
    # No gripper has the part: withdraw the arm, take pictures, plan from where the part is.
    (Event.PART_DROPPED, _HOLDING, "withdrawing"),
    (Event.WITHDRAWN, ("withdrawing",), "acquiring"),
    # A part that was lost may still be rolling: pictures again before anybody is called.
    (Event.PART_NOT_SEEN, ("recognising",), "acquiring"),
    # The part is held otherwise than planned, or less of it was in sight than planned.
    (Event.PLAN_VOID, ("recovering", "presenting", "inspecting", "handing"), "planning"),
    (Event.ALL_SEEN, ("inspecting",), "placing"),
    (Event.PLACED, ("placing", "recovering"), COMPLETING),
    (Event.PART_DONE, (COMPLETING,), "acquiring"),
)
# The mode after a piece of work has ended in a mode. Work about to be resumed is paused again,
# since its first motion is no longer the one that the operator saw.
_MODE_AFTER: Final = {mode: mode for mode in Mode} | {Mode.UNSUSPENDING: Mode.SUSPENDED}

TABLE: Final[tuple[tuple[Event, tuple[str, ...], str], ...]] = (
    (Event.RESET, ("stopped", "complete", "held"), RESETTING),
    (Event.RESET_DONE, (RESETTING,), "idle"),
    (Event.START, ("idle",), state_of("acquiring")),
    # An earlier run left a part in a gripper, and what the cell may do was accepted.
    (Event.RECOVER, ("idle",), state_of("recovering")),
    *(
        (event, (state_of(work, mode),), state_of(target, _MODE_AFTER[mode]))
        for event, works, target in WORK_TABLE
        for work in works
        for mode in Mode
    ),
    # In these states no gripper should have a part: a person took it, or custody is wrong.
    (
        Event.PART_DROPPED,
        tuple(state_of(work, mode) for work in _BESIDE_EXECUTE for mode in Mode),
        "holding",
    ),
    # The check before a resume found the part gone where it is being looked for already.
    *(
        (Event.PART_DROPPED, (state_of(work, Mode.UNSUSPENDING),), state_of(work, Mode.SUSPENDED))
        for work in _LOOKING
    ),
    # The last part was counted, or a person took it out.
    (
        Event.BATCH_DONE,
        tuple(state_of(work, mode) for work in (COMPLETING, "withdrawing") for mode in Mode),
        "complete",
    ),
    # Something is wrong with the part, not the cell: hold for a person. Homing may find a part in
    # the fixed gripper, and one may slip out of it until the batch is complete.
    (Event.PART_PROBLEM, _ANY_WORK, "holding"),
    (Event.HOLD_DONE, ("holding",), "held"),
    # What the question of a cell on hold may be answered with; where nothing is homed yet, a reset.
    (Event.UNATTENDED, ("held",), "held"),
    (Event.LOOK_AGAIN, ("held",), state_of("withdrawing")),
    (Event.PART_TAKEN_OUT, ("held",), state_of("withdrawing")),
    # A pause that is under way may become more urgent, never less.
    *(
        (event, (state_of(work, source),), state_of(work, target))
        for event, source, target in (
            *((event, mode, Mode.SUSPENDING) for event in PAUSES for mode in _RUNNING),
            (Event.STEP, Mode.EXECUTE, Mode.SUSPENDING),
            (Event.STEP, Mode.SUSPENDED, Mode.UNSUSPENDING),
            (Event.STEP_BEGUN, Mode.UNSUSPENDING, Mode.SUSPENDING),
            # to be paused again before anything has moved
            *((event, Mode.UNSUSPENDING, Mode.SUSPENDED) for event in PAUSES),
        )
        for work in WORK
        if work != RESETTING
    ),
    # An open door holds the run and does not end it (ADR 38); homing begins anew then.
    *(
        (event, (state_of(work, source),), state_of(work, target))
        for event, source, target in (
            (Event.GUARD_OPENED, Mode.EXECUTE, Mode.SUSPENDING),
            (Event.GUARD_OPENED, Mode.SUSPENDING, Mode.SUSPENDING),
            (Event.GUARD_OPENED, Mode.UNSUSPENDING, Mode.SUSPENDED),
            (Event.PAUSED, Mode.SUSPENDING, Mode.SUSPENDED),
            (Event.RESUME, Mode.SUSPENDED, Mode.UNSUSPENDING),
            (Event.RESUMED, Mode.UNSUSPENDING, Mode.EXECUTE),
        )
        for work in WORK
    ),
    *((Event.ACKNOWLEDGE, (state,), state) for state in _SUSPENDED),
    # After an open door: the arm or a jaw was moved by hand, so that it cannot go on from here.
    *(
        (Event.NOT_PROVEN, (state_of(work, Mode.UNSUSPENDING),), state_of(work, Mode.SUSPENDED))
        for work in WORK
    ),
    # After an open door, with the part in no gripper: somebody may have moved it.
    (
        Event.LOOK_AGAIN,
        tuple(state for state in _UNSUSPENDING if state != _RESETTING[Mode.UNSUSPENDING]),
        state_of("withdrawing"),
    ),
    (Event.STOP, _STOPPABLE, "stopping"),
    (Event.STOP_DONE, ("stopping",), "stopped"),
    (Event.FAULT, (*_FAULTABLE, "stopped", "complete"), "aborting"),
    (Event.ABORT_DONE, ("aborting",), "aborted"),
    (Event.CLEAR, ("aborted",), "clearing"),
    (Event.CLEAR_DONE, ("clearing",), "stopped"),
)

# Sent by people and interlocks; all other events are outcomes of effects.
COMMANDS: Final = (
    Event.RESET, Event.START, Event.RECOVER, Event.STOP, Event.CLEAR, Event.FAULT, *PAUSES,
    Event.RESUME, Event.STEP, Event.GUARD_OPENED, Event.ACKNOWLEDGE,
)  # fmt: skip
# Commands by which a person, or an order that a person gave, permits motion.
PERMITTING: Final = frozenset(
    {
        Event.RESET, Event.START, Event.RECOVER, Event.RESUME, Event.STEP, Event.LOOK_AGAIN,
        Event.PART_TAKEN_OUT,
    }
)  # fmt: skip
# States in which nothing may move, whatever was permitted before.
FORBIDDING: Final = frozenset({*RESTING, "holding", "stopping", "aborting", "clearing"} - {"idle"})
_OUTCOMES: Final = tuple(event for event in Event if event not in COMMANDS)
# States entered by overtaking an effect, with the outcomes that are awaited in them.
_OVERTAKEN: Final[Mapping[str, tuple[Event, ...]]] = {
    "stopping": (Event.STOP_DONE,),
    "stopped": (),
    "aborting": (Event.ABORT_DONE,),
    "aborted": (),
    "holding": (Event.HOLD_DONE,),
    "held": (Event.UNATTENDED, Event.LOOK_AGAIN, Event.PART_TAKEN_OUT),
    "clearing": (Event.CLEAR_DONE,),
}

# Pairs that are expected and change nothing: events, states, reason.
IGNORED: Final[tuple[tuple[tuple[Event, ...], tuple[str, ...], str], ...]] = (
    (
        (Event.FAULT,),
        ("aborting", "aborted"),
        key("already aborting: the first fault is the one on record"),
    ),
    (
        (Event.STOP,),
        ("stopped", "stopping", "aborting", "aborted", "complete", "clearing"),
        key("nothing moves any more"),
    ),
    (
        PAUSES,
        ("stopped", "stopping", "aborting", "aborted", "complete", "clearing", "holding", "held"),
        key("nothing moves any more"),
    ),
    (PAUSES, _SUSPENDED, key("already paused")),
    (
        (Event.GUARD_OPENED,),
        (
            "stopped",
            "idle",
            "stopping",
            "aborting",
            "aborted",
            "complete",
            "clearing",
            "holding",
            "held",
            *_SUSPENDED,
        ),
        key("nothing moves: the next motion waits until the door is closed"),
    ),
    ((Event.RESUME,), _WORKING, key("nothing is paused")),
    ((Event.STEP,), _SUSPENDING, key("already pausing after this step or sooner")),
    ((Event.RESUME, Event.STEP), _UNSUSPENDING, key("already resumed")),
    # The fixed gripper may report late what the arm gripper has already found.
    (
        (Event.PART_DROPPED,),
        tuple(
            state_of(name, mode)
            for mode in Mode
            for name in _LOOKING
            if mode is not Mode.UNSUSPENDING
        ),
        key("no gripper holds the part: the cell is looking for it already"),
    ),
    # A pause may end in the same moment in which its work does, or be overtaken by the next order.
    ((Event.PAUSED,), (*_SUSPENDED, *_UNSUSPENDING, *_WORKING), key("this pause is over")),
    (
        (Event.RESUMED, Event.STEP_BEGUN, Event.NOT_PROVEN),
        (*_SUSPENDED, *_SUSPENDING, *_WORKING),
        key("this pause is over"),
    ),
    ((Event.LOOK_AGAIN,), (*_SUSPENDED, *_SUSPENDING, *_WORKING), key("this pause is over")),
    # The dispatcher reports it again once the pause is over: what follows is no work that waits.
    (
        (Event.RESET_DONE,),
        tuple(state for mode, state in _RESETTING.items() if mode is not Mode.EXECUTE),
        key("homing has ended in a pause: the next step waits until the pause ends"),
    ),
    *(
        (
            tuple(event for event in _OUTCOMES if event not in awaited),
            (state,),
            "outcome of a task that was stopped",
        )
        for state, awaited in _OVERTAKEN.items()
    ),
)

# Pairs that are refused for a reason of their own: events, states, reason.
REFUSED: Final[tuple[tuple[tuple[Event, ...], tuple[str, ...], str], ...]] = (
    (
        (*PAUSES, Event.STEP),
        ("idle", *_RESETTING.values()),
        key("homing finds its references in one go: pause once it is done, or stop"),
    ),
    (
        (Event.RESUME,),
        _SUSPENDING,
        key("the pause has not begun yet: resume once the cell stands still"),
    ),
    (
        (Event.RESUME, Event.STEP),
        ("stopping", "stopped", "aborting", "aborted", "clearing"),
        key("a stop ends the run, and so does a fault: nothing is paused. Start again"),
    ),
    (
        (Event.ACKNOWLEDGE,),
        tuple(state for state in STATES if state not in _SUSPENDED),
        key("nothing is waiting for an acknowledgement"),
    ),
    (
        (Event.RESUME, Event.STEP),
        ("holding", "held"),
        key("the cell waits for an answer: answer its question"),
    ),
)
