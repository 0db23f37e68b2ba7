"""The whole table: every state with every event, and what must hold on every way through it."""

from __future__ import annotations

import re
from collections import deque
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from machine_diagram import arrows, mermaid, stages_mermaid

from controller.cell.machine import (
    ENTRY,
    EXECUTE,
    IGNORED,
    RESTING,
    SEPARATOR,
    STAGES,
    STATES,
    TABLE,
    CellMachine,
    Effect,
    Event,
    verdict_on,
)

HANDLED = {(source, event): target for event, sources, target in TABLE for source in sources}
PAIRS = [(state, event) for state in STATES for event in Event]
IN_EXECUTE = [f"{EXECUTE}{SEPARATOR}{stage}" for stage in STAGES]
# whose effect moves metal, or that may hold a part while they rest
MOVING = ["resetting", "completing", "holding", "stopping", *IN_EXECUTE]
# outcomes of effects, as against what people and interlocks send
COMMANDS = {Event.RESET, Event.START, Event.STOP, Event.CLEAR, Event.FAULT}


def at(state: str) -> CellMachine:
    machine = CellMachine()
    machine.restore(state)
    assert machine.state == state
    return machine


def reachable(start: str, without: frozenset[Event] = frozenset()) -> set[str]:
    seen, todo = {start}, deque([start])
    while todo:
        here = todo.popleft()
        for (source, event), target in HANDLED.items():
            if source == here and event not in without and target not in seen:
                seen.add(target)
                todo.append(target)
    return seen


def test_the_states_are_twenty_one_and_each_works_or_rests() -> None:
    # PackML's words, and within Execute eight stages of a part (ADR 1) and two of recovery
    assert len(STATES) == len(set(STATES)) == 21
    assert set(IN_EXECUTE) <= set(STATES)
    assert set(RESTING) | set(ENTRY) == set(STATES)
    assert not set(RESTING) & set(ENTRY)


@pytest.mark.parametrize(("state", "event"), PAIRS, ids=lambda v: str(getattr(v, "value", v)))
def test_every_pair_is_handled_refused_with_a_reason_or_ignored_on_purpose(
    state: str, event: Event
) -> None:
    machine = at(state)

    decision = machine.dispatch(event)

    assert decision.source == state
    assert decision.target == machine.state
    assert (decision.answer, decision.reason) == verdict_on(state, event)
    if (state, event) in HANDLED:
        assert decision.answer == "handled"
        assert decision.target == HANDLED[state, event]
        entry = ENTRY.get(decision.target)
        assert decision.effects == (() if entry is None else (entry,))
        assert decision.reason == ""
        return
    assert decision.answer in ("ignored", "refused")
    assert decision.effects == ()
    assert machine.state == state
    assert decision.reason
    if decision.answer == "refused":
        possible = {e.value for s, e in HANDLED if s == state}
        assert f"`{event.value}`" in decision.reason
        assert state in decision.reason
        assert set(decision.reason.split("possible: ")[1].split(", ")) == possible


def test_the_table_names_existing_states_only_and_each_pair_once() -> None:
    every = [(source, event) for event, sources, _ in TABLE for source in sources]
    assert len(every) == len(set(every)), "two rows for one pair"
    assert {source for source, _ in every} <= set(STATES)
    assert {target for _, _, target in TABLE} <= set(STATES)
    assert {state for state, _ in IGNORED} <= set(STATES)
    assert all(IGNORED.values())


def test_no_pair_is_both_handled_and_ignored() -> None:
    assert not set(IGNORED) & set(HANDLED)


def test_every_event_is_handled_somewhere() -> None:
    assert {event for _, event in HANDLED} == set(Event)


def test_every_effect_is_set_going_by_one_state_that_has_an_outcome() -> None:
    assert sorted(ENTRY.values()) == sorted(Effect)
    for state in ENTRY:
        outcomes = {e for s, e in HANDLED if s == state} - COMMANDS - {Event.PART_PROBLEM}
        assert outcomes, f"{state} starts work whose end nothing takes note of"


def test_no_state_is_without_a_way_out_and_every_state_is_reached() -> None:
    for state in STATES:
        assert any(s == state and target != state for (s, _), target in HANDLED.items()), state
    assert reachable("stopped") == set(STATES)


def test_every_stage_is_reached_without_anything_going_wrong() -> None:
    trouble = frozenset(
        {
            Event.FAULT,
            Event.STOP,
            Event.PART_PROBLEM,
            Event.GRIP_MISSED,
            Event.CLEAR,
            Event.PART_DROPPED,
            Event.PLAN_VOID,
        }
    )
    assert reachable("stopped", trouble) >= {*IN_EXECUTE, "complete"}


@pytest.mark.parametrize("state", STATES)
def test_from_anywhere_the_cell_can_come_back_to_idle(state: str) -> None:
    assert "idle" in reachable(state)


@pytest.mark.parametrize("state", STATES)
def test_a_fault_anywhere_ends_in_aborting_unless_it_aborts_already(state: str) -> None:
    decision = at(state).dispatch(Event.FAULT)
    if state in ("aborting", "aborted"):
        assert decision.answer == "ignored"
    else:
        assert (decision.target, decision.effects) == ("aborting", (Effect.ABORT_MOTION,))


@pytest.mark.parametrize("state", STATES)
def test_a_stop_is_obeyed_wherever_something_moves_or_is_held(state: str) -> None:
    decision = at(state).dispatch(Event.STOP)
    if (state in MOVING and state != "stopping") or state in ("idle", "held"):
        assert (decision.target, decision.effects) == ("stopping", (Effect.STOP_MOTION,))
    else:
        # nobody who presses stop is told that it means nothing
        assert decision.answer == "ignored"


@pytest.mark.parametrize("state", ["resetting", "completing", *IN_EXECUTE])
def test_trouble_with_the_part_holds_the_cell_wherever_an_effect_may_report_it(state: str) -> None:
    # homing reports a fixture that is not empty: refused, the cell would wait for ever
    decision = at(state).dispatch(Event.PART_PROBLEM)
    assert (decision.target, decision.effects) == ("holding", (Effect.HOLD,))


def test_after_a_fault_only_a_person_gets_the_cell_going() -> None:
    machine = at("aborted")
    for event in Event:
        if event is not Event.CLEAR:
            assert machine.dispatch(event).answer != "handled", event
    assert machine.dispatch(Event.CLEAR).target == "clearing"
    assert machine.dispatch(Event.CLEAR_DONE).target == "stopped"


def test_late_outcomes_of_overtaken_tasks_change_nothing() -> None:
    outcomes = [e for e in Event if e not in COMMANDS]
    for state in ("stopping", "aborting", "holding", "stopped", "aborted", "held", "clearing"):
        for event in outcomes:
            if (state, event) not in HANDLED:
                assert verdict_on(state, event)[0] == "ignored", (state, event)


def test_a_whole_batch_of_two_parts_with_a_hand_off_and_a_missed_grip() -> None:
    machine = CellMachine()
    script = [
        (Event.RESET, Effect.HOME),
        (Event.RESET_DONE, None),
        (Event.START, Effect.ACQUIRE),
        (Event.PICTURE_TAKEN, Effect.RECOGNISE),
        (Event.PART_RECOGNISED, Effect.PLAN),
        (Event.PLANNED, Effect.GRASP),
        (Event.GRIP_MISSED, Effect.ACQUIRE),
        (Event.PICTURE_TAKEN, Effect.RECOGNISE),
        (Event.PART_RECOGNISED, Effect.PLAN),
        (Event.PLANNED, Effect.GRASP),
        (Event.GRASPED, Effect.PRESENT),
        (Event.SHOWN, Effect.INSPECT),
        (Event.INSPECTED, Effect.PRESENT),
        (Event.SHOWN, Effect.INSPECT),
        (Event.HAND_OFF_DUE, Effect.HAND_OFF),
        (Event.HANDED_OFF, Effect.PRESENT),
        (Event.SHOWN, Effect.INSPECT),
        (Event.ALL_SEEN, Effect.PLACE),
        (Event.PLACED, Effect.COMPLETE),
        (Event.PART_DONE, Effect.ACQUIRE),
        (Event.PART_PROBLEM, Effect.HOLD),
        (Event.HOLD_DONE, None),
        (Event.RESET, Effect.HOME),
    ]
    follow(machine, script)


def follow(machine: CellMachine, script: list[tuple[Event, Effect | None]]) -> None:
    for event, effect in script:
        decision = machine.dispatch(event)
        assert decision.answer == "handled", (event, decision)
        assert decision.effects == (() if effect is None else (effect,)), event


def test_a_part_that_falls_is_looked_for_taken_again_and_shown_on() -> None:
    follow(
        at(f"{EXECUTE}{SEPARATOR}presenting"),
        [
            (Event.PART_DROPPED, Effect.WITHDRAW),
            (Event.WITHDRAWN, Effect.ACQUIRE),
            (Event.PICTURE_TAKEN, Effect.RECOGNISE),
            (Event.PART_RECOGNISED, Effect.PLAN),
            (Event.PLANNED, Effect.GRASP),
            (Event.GRASPED, Effect.PRESENT),
            (Event.SHOWN, Effect.INSPECT),
        ],
    )


def test_a_part_held_otherwise_than_planned_is_planned_on_without_putting_it_down() -> None:
    follow(
        at(f"{EXECUTE}{SEPARATOR}inspecting"),
        [
            (Event.PLAN_VOID, Effect.PLAN),
            (Event.PLANNED_ON, Effect.PRESENT),
            (Event.SHOWN, Effect.INSPECT),
            (Event.HAND_OFF_DUE, Effect.HAND_OFF),
            (Event.PLAN_VOID, Effect.PLAN),  # the fixed gripper has it, the hand did not get it
            (Event.PLANNED_ON, Effect.PRESENT),
            (Event.SHOWN, Effect.INSPECT),
            (Event.SET_DOWN_DUE, Effect.SET_DOWN),
            (Event.SET_DOWN, Effect.WITHDRAW),
            (Event.WITHDRAWN, Effect.ACQUIRE),
        ],
    )


@pytest.mark.parametrize("state", STATES)
def test_a_part_that_leaves_the_fixed_gripper_is_never_news_the_table_has_no_answer_to(
    state: str,
) -> None:
    # its keep-alive may say so in any state that something moves in
    if state in MOVING:
        assert verdict_on(state, Event.PART_DROPPED)[0] != "refused"


@pytest.mark.parametrize("state", IN_EXECUTE)
def test_nothing_recovers_by_closing_a_hand_before_the_table_was_looked_at(state: str) -> None:
    if HANDLED.get((state, Event.PART_DROPPED)) is None:
        return
    machine = at(state)
    seen = []
    for event in (
        Event.PART_DROPPED, Event.WITHDRAWN, Event.PICTURE_TAKEN, Event.PART_RECOGNISED,
        Event.PLANNED,
    ):  # fmt: skip
        seen += machine.dispatch(event).effects
    assert seen == [
        Effect.WITHDRAW, Effect.ACQUIRE, Effect.RECOGNISE, Effect.PLAN, Effect.GRASP,
    ]  # fmt: skip


@pytest.mark.parametrize("state", STATES)
def test_a_state_from_the_journal_is_restored_without_effects_and_goes_on(state: str) -> None:
    machine = CellMachine()
    machine.restore(state)
    assert machine.state == state
    event, target = next((e, t) for (s, e), t in HANDLED.items() if s == state)
    assert machine.dispatch(event).target == target
    assert CellMachine(state).state == state


@pytest.mark.parametrize("name", ["", "execute", "acquiring", "Stopped", "execute.acquiring"])
def test_a_state_nobody_knows_is_not_restored(name: str) -> None:
    machine = CellMachine()
    with pytest.raises(ValueError, match="no state"):
        machine.restore(name)
    assert machine.state == "stopped"


def test_the_diagram_shows_exactly_the_table() -> None:
    assert arrows(mermaid()) == {(s, e.value, t) for (s, e), t in HANDLED.items()}


def test_the_manual_shows_the_stages_as_the_table_has_them() -> None:
    manual = Path(__file__).parents[2] / "docs" / "operating.md"
    (drawn,) = re.findall(r"```mermaid\n(.*?)```", manual.read_text(), re.DOTALL)
    assert drawn == stages_mermaid(), "paste what tests/unit/machine_diagram.py --stages prints"


class Walk(RuleBasedStateMachine):
    """Any events in any order, against the plain dictionary."""

    @initialize(state=st.sampled_from(STATES))
    def begin(self, state: str) -> None:
        self.machine = CellMachine()
        self.machine.restore(state)
        self.expected = state

    @rule(event=st.sampled_from(list(Event)))
    def any_event(self, event: Event) -> None:
        self.take(event)

    @rule(data=st.data())
    def an_event_that_does_something(self, data: st.DataObject) -> None:
        here = sorted(e for s, e in HANDLED if s == self.expected)
        self.take(data.draw(st.sampled_from(here)))

    @rule(state=st.sampled_from(STATES))
    def a_restart(self, state: str) -> None:
        self.machine.restore(state)
        self.expected = state

    def take(self, event: Event) -> None:
        before = self.expected
        decision = self.machine.dispatch(event)
        self.expected = HANDLED.get((before, event), before)
        assert (decision.source, decision.target) == (before, self.expected)
        assert (decision.answer == "handled") == ((before, event) in HANDLED)
        assert len(decision.effects) <= 1
        if decision.answer != "handled":
            assert decision.effects == ()
        elif self.expected in ENTRY:
            assert decision.effects == (ENTRY[self.expected],)

    @invariant()
    def is_where_the_table_says(self) -> None:
        if hasattr(self, "machine"):
            assert self.machine.state == self.expected


Walk.TestCase.settings = settings(max_examples=30, stateful_step_count=40, deadline=None)
TestWalk = Walk.TestCase
