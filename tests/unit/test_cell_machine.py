"""The whole transition table: every state with every event, and what every path must keep."""

from __future__ import annotations

import re
from collections import deque
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

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
)
from controller.cell.machine.diagram import mermaid, page, stages_mermaid

ROOT = Path(__file__).parents[2]
# what the cell does, state by state, written down by hand: event>state it leads to
EXPECTED = """
stopped: reset>resetting fault>aborting
idle: start>execute_acquiring stop>stopping fault>aborting
complete: reset>resetting fault>aborting
held: reset>resetting stop>stopping fault>aborting
aborted: clear>clearing
resetting: reset_done>idle part_dropped>holding part_problem>holding stop>stopping fault>aborting
completing: part_done>execute_acquiring batch_done>complete part_dropped>holding
    part_problem>holding stop>stopping fault>aborting
holding: hold_done>held stop>stopping fault>aborting
stopping: stop_done>stopped fault>aborting
aborting: abort_done>aborted
clearing: clear_done>stopped fault>aborting
execute_acquiring: picture_taken>execute_recognising
    part_problem>holding stop>stopping fault>aborting
execute_recognising: part_recognised>execute_planning part_not_seen>execute_acquiring
    part_problem>holding stop>stopping fault>aborting
execute_planning: planned>execute_grasping planned_on>execute_presenting
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
execute_grasping: grasped>execute_presenting grip_missed>execute_acquiring
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
execute_presenting: shown>execute_inspecting plan_void>execute_planning
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
execute_inspecting: inspected>execute_presenting hand_off_due>execute_handing
    set_down_due>execute_lowering all_seen>execute_placing plan_void>execute_planning
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
execute_handing: handed_off>execute_presenting plan_void>execute_planning
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
execute_lowering: set_down>execute_withdrawing
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
execute_withdrawing: withdrawn>execute_acquiring
    part_problem>holding stop>stopping fault>aborting
execute_placing: placed>completing
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
"""
# what sets going what, by hand as well
EFFECTS = {
    "resetting": "home", "completing": "complete", "holding": "hold", "stopping": "stop_motion",
    "aborting": "abort_motion", "clearing": "clear_fault", "execute_acquiring": "acquire",
    "execute_recognising": "recognise", "execute_planning": "plan", "execute_grasping": "grasp",
    "execute_presenting": "present", "execute_inspecting": "inspect",
    "execute_handing": "hand_off", "execute_lowering": "set_down",
    "execute_withdrawing": "withdraw", "execute_placing": "place",
}  # fmt: skip
SENT = {"reset", "start", "stop", "clear", "fault"}  # by people and interlocks, not by effects
# where late outcomes of overtaken effects arrive
AFTER_THE_END = {"stopping", "stopped", "aborting", "aborted", "holding", "held", "clearing"}
NOTHING_MOVES = {"stopped", "stopping", "aborting", "aborted", "complete", "clearing"}
LOOKED_FOR = {"execute_acquiring", "execute_recognising", "execute_withdrawing"}


def listed() -> dict[tuple[str, Event], str]:
    """Read the listing: (state, event) -> the state it leads to."""
    found = {}
    for line in re.sub(r"\n +", " ", EXPECTED).strip().splitlines():
        state, pairs = line.split(": ")
        for pair in pairs.split():
            event, target = pair.split(">")
            assert (state, Event(event)) not in found
            found[state, Event(event)] = target
    return found


def why_ignored(state: str, event: str) -> str:
    """Return why an event that is not listed changes nothing; empty where it is refused."""
    if event == "fault" and state in ("aborting", "aborted"):
        return "already aborting: the first fault is the one on record"
    if event == "stop" and state in NOTHING_MOVES:
        return "nothing moves any more"
    if event == "part_dropped" and state in LOOKED_FOR:
        return "nobody holds the part: it is being looked for already"
    if event not in SENT and state in AFTER_THE_END:
        return "outcome of a task that was stopped"
    return ""


HANDLED = listed()
PAIRS = [(state, event) for state in STATES for event in Event]
IN_EXECUTE = [f"{EXECUTE}{SEPARATOR}{stage}" for stage in STAGES]
# whose effect moves metal, or that may hold a part while they rest
MOVING = ["resetting", "completing", "holding", "stopping", *IN_EXECUTE]
# outcomes of effects, as against what people and interlocks send
COMMANDS = {Event.RESET, Event.START, Event.STOP, Event.CLEAR, Event.FAULT}


def at(state: str) -> CellMachine:
    machine = CellMachine(state)
    assert machine.state == state
    return machine


def answer(state: str, event: Event) -> str:
    return at(state).dispatch(event).answer


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
def test_every_pair_ends_as_it_is_listed_by_hand(state: str, event: Event) -> None:
    machine = at(state)

    decision = machine.dispatch(event)

    assert decision.source == state
    assert decision.target == machine.state
    if (state, event) in HANDLED:
        assert (decision.answer, decision.reason) == ("handled", "")
        assert decision.target == HANDLED[state, event]
        effect = EFFECTS.get(decision.target)
        assert decision.effects == (() if effect is None else (Effect(effect),))
        return
    assert decision.effects == ()
    assert machine.state == state
    ignored = why_ignored(state, event.value)
    if ignored:
        assert (decision.answer, decision.reason) == ("ignored", ignored)
        return
    possible = ", ".join(sorted(e.value for s, e in HANDLED if s == state))
    assert decision.answer == "refused"
    assert decision.reason == f"`{event.value}` means nothing in {state}; possible: {possible}"


def test_the_listing_by_hand_names_every_state() -> None:
    assert {state for state, _ in HANDLED} == set(STATES)
    assert {*EFFECTS, *RESTING} == set(STATES)


def test_the_table_names_existing_states_only_and_each_pair_once() -> None:
    every = [(source, event) for event, sources, _ in TABLE for source in sources]
    assert len(every) == len(set(every)), "two rows for one pair"
    assert {source for source, _ in every} <= set(STATES)
    assert {target for _, _, target in TABLE} <= set(STATES)
    assert all(reason for _, _, reason in IGNORED)


def test_no_two_transitions_of_the_machine_begin_with_one_pair() -> None:
    # `transitions` would take the first of them, and nobody would know of the second
    pairs = [(one.source, one.event) for one in CellMachine().transitions()]
    assert len(pairs) == len(set(pairs))


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
            Event.GRASP_MISSED,
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
                assert answer(state, event) == "ignored", (state, event)


def test_a_whole_batch_of_two_parts_with_a_hand_off_and_a_missed_grip() -> None:
    machine = CellMachine()
    script = [
        (Event.RESET, Effect.HOME),
        (Event.RESET_DONE, None),
        (Event.START, Effect.ACQUIRE),
        (Event.PICTURE_TAKEN, Effect.RECOGNISE),
        (Event.PART_RECOGNISED, Effect.PLAN),
        (Event.PLANNED, Effect.GRASP),
        (Event.GRASP_MISSED, Effect.ACQUIRE),
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
        assert answer(state, Event.PART_DROPPED) != "refused"


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


def arrows(diagram: str) -> set[tuple[str, str, str]]:
    """Read the transitions back: (source, event, target)."""
    found: set[tuple[str, str, str]] = set()
    stages = re.findall(r"^ {8}(\S+) : ", diagram, re.MULTILINE)
    for source, target, event in re.findall(r"(\S+) --> (\S+) : (\S+)", diagram):
        found |= {(s, event, target) for s in (stages if source == EXECUTE else [source])}
    return found


def test_the_diagram_shows_exactly_what_is_listed() -> None:
    assert arrows(mermaid()) == {(s, e.value, t) for (s, e), t in HANDLED.items()}


def test_the_page_on_the_states_is_what_the_machine_draws() -> None:
    drawn = (ROOT / "docs" / "state-machine.md").read_text(encoding="utf-8")
    assert drawn == page(), "run: python -m controller.cell.machine.diagram > docs/state-machine.md"


def test_the_manual_shows_the_stages_as_the_machine_has_them() -> None:
    manual = ROOT / "docs" / "operating.md"
    (drawn,) = re.findall(r"```mermaid\n(.*?)```", manual.read_text(), re.DOTALL)
    assert drawn == stages_mermaid(), "paste: python -m controller.cell.machine.diagram --stages"


class Walk(RuleBasedStateMachine):
    """Any events in any order, against the plain dictionary."""

    @initialize(state=st.sampled_from(STATES))
    def begin(self, state: str) -> None:
        self.machine = CellMachine(state)
        self.expected = state

    @rule(event=st.sampled_from(list(Event)))
    def any_event(self, event: Event) -> None:
        self.take(event)

    @rule(data=st.data())
    def an_event_that_does_something(self, data: st.DataObject) -> None:
        here = sorted(e for s, e in HANDLED if s == self.expected)
        self.take(data.draw(st.sampled_from(here)))

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
