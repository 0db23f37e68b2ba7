"""Decides by the table: (state, event) -> (state, effects). No I/O, no clock, no waiting.

`transitions` decides: a transition of `TABLE` is taken, one of `IGNORED` is an internal transition
that changes nothing, and an event without any is refused with a reason. Callbacks only record the
decision; the dispatcher runs the effects as tasks, and their outcomes come back as events. The
permission to move is decided here, too: some events permit motion, some states forbid it.
`AsyncMachine` is not used: it cancels running callbacks, swallows time-outs and loses queued faults
(cell-facts.md 1).
"""

from dataclasses import dataclass
from functools import partial
from typing import Literal

from transitions import EventData, MachineError
from transitions.extensions.nesting import HierarchicalMachine

from messages import say

from .table import (
    FORBIDDING,
    IGNORED,
    PERMITTING,
    REFUSED,
    SEPARATOR,
    STATES,
    TABLE,
    WORK,
    Effect,
    Event,
    Mode,
    effects_between,
    state_of,
)

Answer = Literal["handled", "ignored", "refused"]


@dataclass(frozen=True, slots=True)
class MachineDecision:
    """The machine's decision on an event.

    Attributes
    ----------
    answer : handled, ignored or refused
    source, target : state before and after
    effects : effects to start now
    reason : reason why it was refused or ignored
    permits : a new permit to move is issued
    forbids : there is no permit to move from here on
    """

    answer: Answer
    source: str
    target: str
    effects: tuple[Effect, ...] = ()
    reason: str = ""
    permits: bool = False
    forbids: bool = False


@dataclass(frozen=True, slots=True)
class Transition:
    """One transition of the machine; `target` is None if the event is ignored on purpose."""

    event: Event
    source: str
    target: str | None


class CellMachine:
    """A present state, and the table of transitions from it."""

    def __init__(self, initial: str = "stopped") -> None:
        self._ignored_because = ""
        self.state: str = initial
        nested = [
            {
                "name": mode.value,
                "children": [w for w in WORK if state_of(w, mode) in _nested(mode)],
            }
            for mode in Mode
        ]
        self._machine = HierarchicalMachine(
            model=self,
            states=[*(s for s in STATES if s not in _ALL_NESTED), *nested],
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

    def _note_ignored(self, reason: str, _: EventData) -> None:
        self._ignored_because = reason

    def dispatch(self, event: Event) -> MachineDecision:
        """Take one event, return the decision; a pair not in the table is refused, not raised."""
        source, self._ignored_because = self.state, ""
        try:
            self.trigger(event.value)  # type: ignore[attr-defined]  # added by transitions
        except MachineError:
            return MachineDecision("refused", source, source, reason=self._why_refused(event))
        if self._ignored_because:
            return MachineDecision("ignored", source, source, reason=self._ignored_because)
        return MachineDecision(
            "handled",
            source,
            self.state,
            effects_between(source, self.state),
            permits=event in PERMITTING,
            forbids=self.state in FORBIDDING,
        )

    def _why_refused(self, event: Event) -> str:
        for events, states, reason in REFUSED:
            if event in events and self.state in states:
                return reason
        possible = sorted(
            t.event for t in self.transitions() if t.source == self.state and t.target
        )
        return say(
            "`{value}` is not possible in {state}; possible: {possible}",
            value=event.value,
            state=self.state,
            possible=", ".join(possible),
        )

    def transitions(self) -> tuple[Transition, ...]:
        """Return all transitions, in the machine's own order."""
        return tuple(
            Transition(Event(event.name), one.source, one.dest)
            for event in self._machine.events.values()
            for of_source in event.transitions.values()
            for one in of_source
        )


def _nested(mode: Mode) -> list[str]:
    """Return the states of a mode nested in it."""
    every = (state_of(work, mode) for work in WORK)
    return [state for state in every if state.startswith(f"{mode}{SEPARATOR}")]


_ALL_NESTED = frozenset(state for mode in Mode for state in _nested(mode))
