"""Decides by the table: (state, event) -> (state, effects). No I/O, no clock, no waiting.

`transitions` decides: a transition of `TABLE` is taken, one of `IGNORED` is an internal transition
that changes nothing, and an event for which there is none is refused with a reason. Callbacks only
note what was decided; the dispatcher runs the effects as tasks, and their outcomes come back as
events. `AsyncMachine` is not used: it cancels running callbacks, swallows time-outs and loses
queued faults (cell-facts.md 1).
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from transitions import EventData, MachineError
from transitions.extensions.nesting import HierarchicalMachine

from .table import ENTRY, EXECUTE, IGNORED, STAGES, STATES, TABLE, Effect, Event, state_of_stage

Answer = Literal["handled", "ignored", "refused"]


@dataclass(frozen=True, slots=True)
class Decision:
    """What the machine did with an event.

    Attributes
    ----------
    answer : handled, ignored or refused
    source, target : state before and after
    effects : what to start now
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
    """A present state, and the table that leads on from it."""

    def __init__(self, initial: str = "stopped") -> None:
        self._effects: list[Effect] = []
        self._ignored_because = ""
        self.state: str = initial
        stages = [self._described(stage, state_of_stage(stage)) for stage in STAGES]
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
        """Return a state as `transitions` requires it: its name, and the note made on entering."""
        effect = ENTRY.get(state)
        return {"name": name, "on_enter": [] if effect is None else partial(self._note, effect)}

    def _note(self, effect: Effect, _: EventData) -> None:
        self._effects.append(effect)

    def _note_ignored(self, reason: str, _: EventData) -> None:
        self._ignored_because = reason

    def dispatch(self, event: Event) -> Decision:
        """Take one event, return the decision; a pair not in the table is refused, not raised."""
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
        """Return all transitions, in the machine's own order."""
        return tuple(
            Transition(Event(event.name), one.source, one.dest)
            for event in self._machine.events.values()
            for of_source in event.transitions.values()
            for one in of_source
        )
