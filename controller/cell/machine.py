"""The cell's mind as a table: (state, event) -> (state, effects). No I/O, no clock, no waiting.

States carry PackML's names; within Execute stand the stages of one part. `transitions` only
holds the table: callbacks append effects to a list, the dispatcher runs them as tasks, and their
outcomes come back as events. `AsyncMachine` is not used: it cancels running callbacks, swallows
time-outs and loses queued faults (cell-facts.md 1).

Every pair of state and event is handled, refused with a reason, or ignored on purpose;
`verdict_on` tells which, and a test builds the whole table.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Literal

from transitions import EventData
from transitions.extensions.nesting import HierarchicalMachine


class Event(StrEnum):
    """What can happen to the cell."""

    RESET = "reset"
    RESET_DONE = "reset_done"
    START = "start"
    PICTURE_TAKEN = "picture_taken"
    PART_RECOGNISED = "part_recognised"
    PLANNED = "planned"
    PLANNED_ON = "planned_on"
    GRASPED = "grasped"
    GRIP_MISSED = "grip_missed"
    SHOWN = "shown"
    INSPECTED = "inspected"
    HAND_OFF_DUE = "hand_off_due"
    HANDED_OFF = "handed_off"
    SET_DOWN_DUE = "set_down_due"
    SET_DOWN = "set_down"
    PART_DROPPED = "part_dropped"
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
    """What the dispatcher has to set going."""

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

# state -> effect on entering it
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


def _stage(name: str) -> str:
    return f"{EXECUTE}{SEPARATOR}{name}"


_IN_EXECUTE: Final = tuple(_stage(name) for name in STAGES)
# stages in which some gripper has the part, or is about to
_HOLDING: Final = tuple(
    _stage(name)
    for name in ("planning", "grasping", "presenting", "inspecting", "handing", "lowering",
                 "placing")
)  # fmt: skip
# Stop is obeyed wherever something may move; from `held` too, where a part may hang in the arm
_STOPPABLE: Final = ("resetting", "completing", "holding", "held", "idle", *_IN_EXECUTE)
# A fault is taken even at rest: a door that opens or a device that leaves is known at once
_FAULTABLE: Final = (*_STOPPABLE, "stopping", "clearing")

TABLE: Final[tuple[tuple[Event, tuple[str, ...], str], ...]] = (
    (Event.RESET, ("stopped", "complete", "held"), "resetting"),
    (Event.RESET_DONE, ("resetting",), "idle"),
    (Event.START, ("idle",), _stage("acquiring")),
    (Event.PICTURE_TAKEN, (_stage("acquiring"),), _stage("recognising")),
    (Event.PART_RECOGNISED, (_stage("recognising"),), _stage("planning")),
    (Event.PLANNED, (_stage("planning"),), _stage("grasping")),
    # a plan made while a gripper has the part
    (Event.PLANNED_ON, (_stage("planning"),), _stage("presenting")),
    (Event.GRASPED, (_stage("grasping"),), _stage("presenting")),
    # a missed grip may have pushed the part: look again, never close again blindly
    (Event.GRIP_MISSED, (_stage("grasping"),), _stage("acquiring")),
    (Event.SHOWN, (_stage("presenting"),), _stage("inspecting")),
    (Event.INSPECTED, (_stage("inspecting"),), _stage("presenting")),
    (Event.HAND_OFF_DUE, (_stage("inspecting"),), _stage("handing")),
    (Event.HANDED_OFF, (_stage("handing"),), _stage("presenting")),
    (Event.SET_DOWN_DUE, (_stage("inspecting"),), _stage("lowering")),
    (Event.SET_DOWN, (_stage("lowering"),), _stage("withdrawing")),
    # nobody holds it any more: away from above the table, look again, plan from where it lies
    (Event.PART_DROPPED, _HOLDING, _stage("withdrawing")),
    # outside of these a loss means that a person was at it, or that the books are wrong
    (Event.PART_DROPPED, ("resetting", "completing"), "holding"),
    (Event.WITHDRAWN, (_stage("withdrawing"),), _stage("acquiring")),
    # it is held, but not as the plan has it, or the plan has shown less than it meant to
    (
        Event.PLAN_VOID,
        (_stage("presenting"), _stage("inspecting"), _stage("handing")),
        _stage("planning"),
    ),
    (Event.ALL_SEEN, (_stage("inspecting"),), _stage("placing")),
    (Event.PLACED, (_stage("placing"),), "completing"),
    (Event.PART_DONE, ("completing",), _stage("acquiring")),
    (Event.BATCH_DONE, ("completing",), "complete"),
    # the part, not the cell, is the trouble: stop where it is safe and ask a person; homing finds
    # a fixture that still holds something, and a part may slip out of it until the batch rests
    (Event.PART_PROBLEM, ("resetting", "completing", *_IN_EXECUTE), "holding"),
    (Event.HOLD_DONE, ("holding",), "held"),
    (Event.STOP, _STOPPABLE, "stopping"),
    (Event.STOP_DONE, ("stopping",), "stopped"),
    (Event.FAULT, (*_FAULTABLE, "stopped", "complete"), "aborting"),
    (Event.ABORT_DONE, ("aborting",), "aborted"),
    (Event.CLEAR, ("aborted",), "clearing"),
    (Event.CLEAR_DONE, ("clearing",), "stopped"),
)

_HANDLED: Final = frozenset((source, event) for event, sources, _ in TABLE for source in sources)

# Pairs that are no mistake and change nothing
IGNORED: Final[Mapping[tuple[str, Event], str]] = {
    **{(s, Event.FAULT): "already aborting: the first fault is the one on record"
       for s in ("aborting", "aborted")},
    **{(s, Event.STOP): "nothing moves any more" for s in
       ("stopped", "stopping", "aborting", "aborted", "complete", "clearing")},
    # the fixture's keep-alive may notice late what the hand's own look has told already
    **{
        (_stage(name), Event.PART_DROPPED): "nobody holds the part: it is being looked for already"
        for name in ("acquiring", "recognising", "withdrawing")
    },
    # outcomes of a task that was overtaken by a stop or a fault arrive late
    **{
        (s, e): "outcome of a task that was stopped"
        for s in ("stopping", "stopped", "aborting", "aborted", "holding", "held", "clearing")
        for e in (
            Event.RESET_DONE, Event.PICTURE_TAKEN, Event.PART_RECOGNISED, Event.PLANNED,
            Event.PLANNED_ON, Event.GRASPED, Event.GRIP_MISSED, Event.SHOWN, Event.INSPECTED,
            Event.HAND_OFF_DUE, Event.HANDED_OFF, Event.SET_DOWN_DUE, Event.SET_DOWN,
            Event.PART_DROPPED, Event.WITHDRAWN, Event.PLAN_VOID, Event.ALL_SEEN, Event.PLACED,
            Event.PART_DONE, Event.BATCH_DONE, Event.PART_PROBLEM, Event.HOLD_DONE,
            Event.STOP_DONE, Event.ABORT_DONE, Event.CLEAR_DONE,
        )
        if (s, e) not in _HANDLED
    },
}  # fmt: skip

Answer = Literal["handled", "ignored", "refused"]


@dataclass(frozen=True, slots=True)
class Decision:
    """What the table said to an event.

    Attributes
    ----------
    answer : handled, ignored or refused
    source, target : state before and after
    effects : what to set going now
    reason : why it was refused or ignored
    """

    answer: Answer
    source: str
    target: str
    effects: tuple[Effect, ...] = ()
    reason: str = ""


class CellMachine:
    """The table with a present state."""

    def __init__(self, initial: str = "stopped") -> None:
        self._effects: list[Effect] = []
        self.state: str = initial
        states: list[Any] = [s for s in STATES if not s.startswith(EXECUTE)]
        states.append({"name": EXECUTE, "children": list(STAGES)})
        self._machine = HierarchicalMachine(
            model=self,
            states=states,
            initial=initial,
            auto_transitions=False,
            send_event=True,
            queued=True,
            after_state_change="_note_effect",
        )
        for event, sources, target in TABLE:
            for source in sources:
                self._machine.add_transition(event.value, source, target)

    def _note_effect(self, event: EventData) -> None:
        effect = ENTRY.get(self.state)
        if effect is not None:
            self._effects.append(effect)

    def dispatch(self, event: Event) -> Decision:
        """Take one event; never raises for a pair the table does not know."""
        source = self.state
        answer, reason = verdict_on(source, event)
        if answer != "handled":
            return Decision(answer, source, source, reason=reason)
        self._effects = []
        self.trigger(event.value)  # type: ignore[attr-defined]  # added by transitions
        return Decision("handled", source, self.state, tuple(self._effects))

    def restore(self, state: str) -> None:
        """Put the machine into a state read from a journal, without effects."""
        if state not in STATES:
            raise ValueError(f"no state {state!r}")
        self._machine.set_state(state, self)


def verdict_on(state: str, event: Event) -> tuple[Answer, str]:
    """Return what the table does with an event in a state, and why if it does nothing."""
    if (state, event) in _HANDLED:
        return "handled", ""
    if (state, event) in IGNORED:
        return "ignored", IGNORED[state, event]
    possible = sorted(e.value for s, e in _HANDLED if s == state)
    return "refused", f"`{event.value}` means nothing in {state}; possible: {', '.join(possible)}"
