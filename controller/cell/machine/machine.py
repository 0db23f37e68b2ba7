"""The cell's mind as a table: (state, event) -> (state, effects). No I/O, no clock, no waiting.

States carry PackML's names; within Execute stand the stages of one part. `transitions` decides: a
transition of `TABLE` is taken, one of `IGNORED` is an internal transition that changes nothing, and
an event for which there is none is refused with a reason. Callbacks only note what was decided;
the dispatcher runs the effects as tasks, and their outcomes come back as events. `AsyncMachine` is
not used: it cancels running callbacks, swallows time-outs and loses queued faults
(cell-facts.md 1).

docs/state-machine.md is drawn from the machine (`controller.cell.machine.diagram`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any, Final, Literal

from transitions import EventData, MachineError
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
    GRASP_MISSED = "grip_missed"
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
    (Event.GRASP_MISSED, (_stage("grasping"),), _stage("acquiring")),
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

# What people and interlocks send; all other events are outcomes of effects
COMMANDS: Final = (Event.RESET, Event.START, Event.STOP, Event.CLEAR, Event.FAULT)
_OUTCOMES: Final = tuple(event for event in Event if event not in COMMANDS)
# Where an effect was overtaken by a stop or a fault, with the outcome that is waited for there
_OVERTAKEN: Final[Mapping[str, Event | None]] = {
    "stopping": Event.STOP_DONE,
    "stopped": None,
    "aborting": Event.ABORT_DONE,
    "aborted": None,
    "holding": Event.HOLD_DONE,
    "held": None,
    "clearing": Event.CLEAR_DONE,
}

# Pairs that are no mistake and change nothing: events, states, why
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
    # the fixed gripper's keep-alive may notice late what the arm gripper's own look has shown
    (
        (Event.PART_DROPPED,),
        tuple(_stage(name) for name in ("acquiring", "recognising", "withdrawing")),
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

Answer = Literal["handled", "ignored", "refused"]


@dataclass(frozen=True, slots=True)
class Decision:
    """What the machine did with an event.

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


@dataclass(frozen=True, slots=True)
class Transition:
    """One transition of the machine; `target` is None where the event is ignored on purpose."""

    event: Event
    source: str
    target: str | None


class CellMachine:
    """The table with a present state."""

    def __init__(self, initial: str = "stopped") -> None:
        self._effects: list[Effect] = []
        self._ignored_because = ""
        self.state: str = initial
        stages = [self._described(stage, _stage(stage)) for stage in STAGES]
        states = [self._described(s, s) for s in STATES if not s.startswith(EXECUTE)]
        self._machine = HierarchicalMachine(
            model=self,
            states=[*states, {"name": EXECUTE, "children": stages}],
            initial=initial,
            auto_transitions=False,
            send_event=True,
        )
        for event, sources, target in TABLE:
            self._machine.add_transition(event.value, list(sources), target)
        for events, sources, reason in IGNORED:
            for event in events:
                note = partial(self._note_ignored, reason)
                self._machine.add_transition(event.value, list(sources), None, after=note)

    def _described(self, name: str, state: str) -> dict[str, Any]:
        """Return a state as `transitions` takes it: its name, and what is noted on entering it."""
        effect = ENTRY.get(state)
        return {"name": name, "on_enter": [] if effect is None else partial(self._note, effect)}

    def _note(self, effect: Effect, _: EventData) -> None:
        self._effects.append(effect)

    def _note_ignored(self, reason: str, _: EventData) -> None:
        self._ignored_because = reason

    def dispatch(self, event: Event) -> Decision:
        """Take one event; never raises for a pair the table does not know."""
        source, self._effects, self._ignored_because = self.state, [], ""
        try:
            self.trigger(event.value)  # type: ignore[attr-defined]  # added by transitions
        except MachineError:
            possible = sorted(
                t.event for t in self.transitions() if t.source == source and t.target
            )
            reason = f"`{event.value}` means nothing in {source}; possible: {', '.join(possible)}"
            return Decision("refused", source, source, reason=reason)
        if self._ignored_because:
            return Decision("ignored", source, source, reason=self._ignored_because)
        return Decision("handled", source, self.state, tuple(self._effects))

    def transitions(self) -> tuple[Transition, ...]:
        """Return what the machine was built of, in its own order."""
        return tuple(
            Transition(Event(event.name), one.source, one.dest)
            for event in self._machine.events.values()
            for of_source in event.transitions.values()
            for one in of_source
        )
