"""The whole transition table: every state with every event, and what every path must keep."""

from __future__ import annotations

import re
from collections import deque
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from controller.cell.machine import (
    ENTRY,
    EXECUTE,
    FORBIDDING,
    IGNORED,
    PAUSE_EFFECTS,
    PERMITTING,
    REFUSED,
    RESTING,
    SEPARATOR,
    STAGES,
    STATES,
    TABLE,
    WORK,
    CellMachine,
    Effect,
    Event,
    MachineDecision,
)
from controller.cell.machine.diagram import mermaid, page, pauses_mermaid, stages_mermaid

ROOT = Path(__file__).parents[2]
# what the cell does, state by state, written down by hand: event>state it leads to
EXPECTED = """
stopped: reset>resetting fault>aborting
idle: start>execute_acquiring recover>execute_recovering stop>stopping fault>aborting
complete: reset>resetting fault>aborting
held: reset>resetting stop>stopping fault>aborting unattended>held look_again>execute_withdrawing
    part_taken_out>execute_withdrawing
aborted: clear>clearing
resetting: reset_done>idle part_dropped>holding part_problem>holding stop>stopping fault>aborting
completing: part_done>execute_acquiring batch_done>complete part_dropped>holding
    part_problem>holding stop>stopping fault>aborting
holding: hold_done>held stop>stopping fault>aborting
stopping: stop_done>stopped fault>aborting
aborting: abort_done>aborted
clearing: clear_done>stopped fault>aborting
execute_recovering: plan_void>execute_planning placed>completing
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
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
execute_withdrawing: withdrawn>execute_acquiring batch_done>complete
    part_problem>holding stop>stopping fault>aborting
execute_placing: placed>completing
    part_dropped>execute_withdrawing part_problem>holding stop>stopping fault>aborting
"""
# the same of pauses; a line holds for every piece of work, and the work stays the same; homing
# pauses for a door alone
PAUSES = """
execute: pause_after_step>suspending pause_at_safe_point>suspending pause_now>suspending
    step>suspending guard_opened>suspending
suspending: guard_opened>suspending paused>suspended
    pause_after_step>suspending pause_at_safe_point>suspending pause_now>suspending
suspended: resume>unsuspending step>unsuspending acknowledge>suspended
unsuspending: guard_opened>suspended not_proven>suspended resumed>execute step_begun>suspending
    pause_after_step>suspended pause_at_safe_point>suspended pause_now>suspended
"""
# the mode in which the next work is entered, where work ends in a mode
NEXT_MODE = {
    "execute": "execute", "suspending": "suspending", "suspended": "suspended",
    "unsuspending": "suspended",
}  # fmt: skip
# what sets going what, by hand as well
EFFECTS = {
    "resetting": "home", "completing": "complete", "holding": "hold", "stopping": "stop_motion",
    "held": "consult",
    "aborting": "abort_motion", "clearing": "clear_fault", "execute_acquiring": "acquire",
    "execute_recognising": "recognise", "execute_planning": "plan", "execute_grasping": "grasp",
    "execute_presenting": "present", "execute_inspecting": "inspect",
    "execute_recovering": "recover", "execute_handing": "hand_off",
    "execute_lowering": "set_down",
    "execute_withdrawing": "withdraw", "execute_placing": "place",
}  # fmt: skip
MODE_EFFECTS = {"suspending": "suspend", "unsuspending": "unsuspend"}
# by people and interlocks, not by effects
PAUSE_NAMES = {"pause_after_step", "pause_at_safe_point", "pause_now"}
SENT = {
    "reset", "start", "recover", "stop", "clear", "fault", "resume", "step", "guard_opened",
    "acknowledge", *PAUSE_NAMES,
}  # fmt: skip
# after these a permit is new; a person, or the order that a person gave, sends them
PERMIT = {"reset", "start", "recover", "resume", "step", "look_again", "part_taken_out"}
# nothing may move in these, whatever was permitted before
NO_PERMIT = {
    "stopped", "stopping", "aborting", "aborted", "clearing", "holding", "held", "complete",
}  # fmt: skip
# where late outcomes of overtaken effects arrive
AFTER_THE_END = {"stopping", "stopped", "aborting", "aborted", "holding", "held", "clearing"}
NOTHING_MOVES = {"stopped", "stopping", "aborting", "aborted", "complete", "clearing"}
LOOKED_FOR = {"execute_acquiring", "execute_recognising", "execute_withdrawing"}


def parsed(text: str) -> list[tuple[str, str, str]]:
    """Read a listing: (state, event, the state it leads to)."""
    found = []
    for line in re.sub(r"\n +", " ", text).strip().splitlines():
        state, pairs = line.split(": ")
        found += [(state, *pair.split(">")) for pair in pairs.split()]
    return found


def split(state: str) -> tuple[str, str]:
    """Return mode and work of a state; ("", state) where it is no work."""
    if state in ("resetting", "completing"):
        return "execute", state
    mode, _, work = state.partition("_")
    return (mode, work) if work else ("", state)


def joined(mode: str, work: str) -> str:
    is_alone = mode == "execute" and work in ("resetting", "completing")
    return work if is_alone else f"{mode}_{work}"


def listed() -> dict[tuple[str, Event], str]:
    """Return all that is listed: (state, event) -> the state it leads to."""
    found: dict[tuple[str, Event], str] = {}

    def add(state: str, event: str, target: str) -> None:
        assert (state, Event(event)) not in found
        found[state, Event(event)] = target

    works = []
    for state, event, target in parsed(EXPECTED):
        mode, work = split(state)
        if not mode:
            add(state, event, target)
            continue
        works.append(work)
        for each, after in NEXT_MODE.items():
            if event == "reset_done" and each != "execute":
                continue
            next_mode, next_work = split(target)
            add(joined(each, work), event, joined(after, next_work) if next_mode else target)
    for mode, event, target in parsed(PAUSES):
        for work in dict.fromkeys(works):
            if work != "resetting" or event not in PAUSE_NAMES | {"step", "step_begun"}:
                add(joined(mode, work), event, joined(target, work))
    for (
        state
    ) in LOOKED_FOR:  # the check before a resume may find a part gone that nobody should have
        work = split(state)[1]
        add(joined("unsuspending", work), "part_dropped", joined("suspended", work))
    for work in set(works) - {"resetting"}:  # after an open door, where no gripper has the part
        add(joined("unsuspending", work), "look_again", "execute_withdrawing")
    return found


def expected_effects(source: str, target: str) -> tuple[Effect, ...]:
    """Return what a transition sets going: work that is new, then what its pause needs."""
    (mode, work), (next_mode, next_work) = split(source), split(target)
    found = []
    if source != target and (not next_mode or next_work != work):
        found += [EFFECTS.get(target if not next_mode else joined("execute", next_work))]
    if next_mode and next_mode != mode:
        found += [MODE_EFFECTS.get(next_mode)]
    return tuple(Effect(one) for one in found if one is not None)


def why_ignored(state: str, event: str) -> str:
    """Return why an event that is not listed changes nothing; empty where it is refused."""
    if event == "fault" and state in ("aborting", "aborted"):
        return "already aborting: the first fault is the one on record"
    if event == "stop" and state in NOTHING_MOVES:
        return "nothing moves any more"
    mode, work = split(state)
    if event in PAUSE_NAMES and state in (NOTHING_MOVES | {"holding", "held"}):
        return "nothing moves any more"
    if event in PAUSE_NAMES and mode == "suspended":
        return "already paused"
    if event == "guard_opened" and (mode == "suspended" or not mode):
        return "nothing moves: the next motion waits until the door is closed"
    if event == "resume" and mode == "execute":
        return "nothing is paused"
    if event == "step" and mode == "suspending":
        return "already pausing after this step or sooner"
    if event in ("resume", "step") and mode == "unsuspending":
        return "already resumed"
    if event in ("look_again", "step_begun") and state == "unsuspending_resetting":
        return ""  # nothing was looked at yet, and homing is no step
    if event in ("paused", "resumed", "step_begun", "not_proven", "look_again") and mode:
        return "this pause is over"
    if event == "reset_done" and work == "resetting":
        return "homing has ended in a pause: the next step waits until the pause ends"
    if event == "part_dropped" and mode and joined("execute", work) in LOOKED_FOR:
        return "no gripper holds the part: the cell is looking for it already"
    if event not in SENT and state in AFTER_THE_END:
        return "outcome of a task that was stopped"
    return ""


def why_refused(state: str, event: str) -> str:
    """Return why an event is refused that is possible elsewhere; empty where there is none."""
    mode, work = split(state)
    if (state == "idle" or work == "resetting") and event in PAUSE_NAMES | {"step"}:
        return "homing finds its references in one go: pause once it is done, or stop"
    if event == "acknowledge":
        return "nothing is waiting for an acknowledgement"
    if event == "resume" and mode == "suspending":
        return "the pause has not begun yet: resume once the cell stands still"
    if event in ("resume", "step") and state in NOTHING_MOVES - {"complete"}:
        return "a stop ends the run, and so does a fault: nothing is paused. Start again"
    if event in ("resume", "step") and state in ("holding", "held"):
        return "the cell waits for an answer: answer its question"
    return ""


HANDLED = listed()
IN_EXECUTE = [f"{EXECUTE}{SEPARATOR}{stage}" for stage in STAGES]
# whose effect moves metal, or that may hold a part while they rest
MOVING = ["resetting", "completing", "holding", "stopping", *IN_EXECUTE]
IN_WORK = [state for state in STATES if split(state)[0]]
# outcomes of effects, as against what people and interlocks send
COMMANDS = {Event(name) for name in SENT}


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


def test_the_states_are_packmls_and_those_of_work_stand_in_four_modes() -> None:
    # nine states of the cell, and within Execute eight stages of a part (ADR 1), three of recovery,
    # their completion, and homing, in four modes each
    assert len(STATES) == len(set(STATES)) == 9 + 4 * 13
    assert set(IN_EXECUTE) <= set(STATES)
    paused = {state for state in STATES if split(state)[0] == "suspended"}
    assert set(RESTING) == {"stopped", "idle", "complete", "held", "aborted"} | paused
    assert {split(state)[1] for state in IN_WORK} == set(WORK)


@pytest.mark.parametrize("state", STATES)
def test_every_pair_ends_as_it_is_listed_by_hand(state: str) -> None:
    machine = at(state)
    for event in Event:
        check_pair(machine, event)
        machine.state = state  # a machine is no more than its table and this


def check_pair(machine: CellMachine, event: Event) -> None:
    state = machine.state

    decision = machine.dispatch(event)

    assert decision.source == state
    assert decision.target == machine.state
    if (state, event) in HANDLED:
        assert (decision.answer, decision.reason) == ("handled", "")
        assert decision.target == HANDLED[state, event]
        assert decision.effects == expected_effects(state, decision.target)
        assert decision.permits == (event.value in PERMIT)
        is_paused = split(decision.target)[0] == "suspended"
        assert decision.forbids == (is_paused or decision.target in NO_PERMIT)
        return
    assert (decision.effects, decision.permits, decision.forbids) == ((), False, False)
    assert machine.state == state
    ignored = why_ignored(state, event.value)
    if ignored:
        assert (decision.answer, decision.reason) == ("ignored", ignored)
        return
    assert decision.answer == "refused"
    if refused := why_refused(state, event.value):
        assert decision.reason == refused
        return
    possible = ", ".join(sorted(e.value for s, e in HANDLED if s == state))
    assert decision.reason == f"`{event.value}` is not possible in {state}; possible: {possible}"


def test_the_listing_by_hand_names_every_state() -> None:
    assert {state for state, _ in HANDLED} == set(STATES)
    assert {*EFFECTS, *RESTING} >= {s for s in STATES if split(s)[0] in ("", "execute")}


def test_the_table_names_existing_states_only_and_each_pair_once() -> None:
    every = [(source, event) for event, sources, _ in TABLE for source in sources]
    assert len(every) == len(set(every)), "two rows for one pair"
    assert {source for source, _ in every} <= set(STATES)
    assert {target for _, _, target in TABLE} <= set(STATES)
    assert all(reason for _, _, reason in (*IGNORED, *REFUSED))


def test_no_two_transitions_of_the_machine_begin_with_one_pair() -> None:
    # `transitions` would take the first of them, and nobody would know of the second
    pairs = [(one.source, one.event) for one in CellMachine().transitions()]
    assert len(pairs) == len(set(pairs))


def test_every_event_is_handled_somewhere() -> None:
    assert {event for _, event in HANDLED} == set(Event)


def test_every_effect_is_set_going_by_one_state_that_has_an_outcome() -> None:
    assert sorted([*ENTRY.values(), *WORK.values(), *PAUSE_EFFECTS]) == sorted(Effect)
    for state in (*ENTRY, *IN_EXECUTE, "resetting", "completing"):
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
    if (state in MOVING and state != "stopping") or state in ("idle", "held", *IN_WORK):
        assert (decision.target, decision.effects) == ("stopping", (Effect.STOP_MOTION,))
    else:
        # nobody who presses stop is told that it means nothing
        assert decision.answer == "ignored"


@pytest.mark.parametrize("state", IN_WORK)
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
        machine = at(state)
        for event in outcomes:
            if (state, event) not in HANDLED:
                assert machine.dispatch(event).answer == "ignored", (state, event)


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
        (Event.HOLD_DONE, Effect.CONSULT),
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
    if state in MOVING or state in IN_WORK:
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
    plain = {
        (s, e.value, t)
        for (s, e), t in HANDLED.items()
        if {split(s)[0], split(t)[0]} <= {"", "execute"}
    }
    assert arrows(mermaid()) == plain


def test_the_diagram_of_pauses_shows_exactly_what_is_listed() -> None:
    drawn = set()
    for source, target, event, works in re.findall(
        r"(\w+) --> (\w+) : (\w+)(?: \((.*)\))?", pauses_mermaid()
    ):
        without = works.removeprefix("all but ") if works.startswith("all but ") else ""
        every = [work for work in WORK if work not in without.split(", ")]
        for work in works.split(", ") if works and not without else every:
            drawn.add((joined(source, work), event, joined(target, work)))
    kept = {
        (s, e.value, t)
        for (s, e), t in HANDLED.items()
        if split(s)[0] and split(t)[0] and split(s)[1] == split(t)[1]
    }
    assert drawn == kept


def test_the_page_on_the_states_is_what_the_machine_draws() -> None:
    drawn = (ROOT / "docs" / "state-machine.md").read_text(encoding="utf-8")
    assert drawn == page(), "run: python -m controller.cell.machine.diagram > docs/state-machine.md"


def test_the_manual_shows_the_stages_as_the_machine_has_them() -> None:
    manual = ROOT / "docs" / "operating" / "recovery.md"
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
        if decision.answer != "handled":
            assert decision.effects == ()
        else:
            assert decision.effects == expected_effects(before, self.expected)

    @invariant()
    def is_where_the_table_says(self) -> None:
        if hasattr(self, "machine"):
            assert self.machine.state == self.expected


Walk.TestCase.settings = settings(max_examples=30, stateful_step_count=40, deadline=None)
TestWalk = Walk.TestCase


# effects during which metal may move: all but pictures, computing, counting, asking and waiting
MOVES = {
    Effect.HOME, Effect.GRASP, Effect.PRESENT, Effect.HAND_OFF, Effect.SET_DOWN, Effect.WITHDRAW,
    Effect.PLACE, Effect.UNSUSPEND,
}  # fmt: skip
# what each effect may report, as its action's docstring has it; a fault, a problem, a lost part may
# be reported at any time
OUTCOMES = {
    "home": "reset_done", "acquire": "picture_taken", "recognise": "part_recognised part_not_seen",
    "plan": "planned planned_on", "grasp": "grasped grip_missed", "present": "shown plan_void",
    "inspect": "inspected hand_off_due set_down_due all_seen plan_void",
    "hand_off": "handed_off plan_void", "set_down": "set_down", "withdraw": "withdrawn batch_done",
    "place": "placed", "complete": "part_done batch_done", "hold": "hold_done",
    "consult": "unattended look_again part_taken_out reset stop", "stop_motion": "stop_done",
    "abort_motion": "abort_done", "clear_fault": "clear_done", "suspend": "paused",
    "unsuspend": "resumed step_begun look_again not_proven guard_opened",
}  # fmt: skip


@cache
def stopped_from(state: str) -> str:
    """Return where a stop leads from a state, once what it sets going has ended."""
    machine = CellMachine(state)
    for event in (Event.STOP, Event.STOP_DONE, Event.ABORT_DONE, Event.CLEAR_DONE):
        machine.dispatch(event)
    return machine.state


class Cell(RuleBasedStateMachine):
    """A cell as the dispatcher runs it: effects that are under way, a permit, people, chance.

    Effects that a new state has no use for end; those that it keeps go on. Whatever happens, in any
    order, the invariants hold.
    """

    def __init__(self) -> None:
        super().__init__()
        self.machine = CellMachine()
        self.permit = ""
        self.work: Effect | None = None
        self.pause: Effect | None = None
        self.has_been_stopped = False

    def take(self, event: Event, reporter: Effect | None = None) -> MachineDecision:
        decision = self.machine.dispatch(event)
        if decision.answer != "handled":
            return decision
        if event.value in PERMIT:
            self.permit, self.has_been_stopped = event.value, False
        if decision.forbids:
            self.permit = ""
        if event in (Event.STOP, Event.FAULT):
            self.has_been_stopped = True
        (mode, work), (next_mode, next_work) = split(decision.source), split(decision.target)
        if mode != next_mode or self.pause is reporter:
            self.pause = None
        if self.work is reporter or (
            decision.source != decision.target and not (mode and next_mode and work == next_work)
        ):
            self.work = None
        for effect in decision.effects:
            if effect in MOVES and not next_mode.startswith("suspend"):
                # where the cell pauses, what is begun waits at the gate
                assert self.permit, (decision, effect)
                assert not self.has_been_stopped, (decision, effect)
            if effect.value in MODE_EFFECTS.values():
                assert self.pause is None, "a pause begins while another one ends"
                self.pause = effect
            else:
                assert self.work is None, (decision, self.work)
                self.work = effect
        return decision

    @rule(name=st.sampled_from(sorted(SENT - {"fault"})))
    def a_person_sends(self, name: str) -> None:
        self.take(Event(name))

    @rule()
    def an_interlock_opens(self) -> None:
        decision = self.take(Event.FAULT)
        assert decision.target in ("aborting", "aborted")

    @rule()
    def the_fixed_gripper_loses_its_part(self) -> None:
        assert self.take(Event.PART_DROPPED).answer != "refused" or not split(self.machine.state)[0]

    @rule(data=st.data(), which=st.sampled_from(["work", "work", "work", "pause"]))
    def an_effect_ends(self, data: st.DataObject, which: str) -> None:
        effect = self.work if which == "work" else self.pause
        if effect is None:
            return
        names = OUTCOMES[effect.value].split()
        if effect in MOVES | {Effect.PLAN, Effect.INSPECT, Effect.ACQUIRE, Effect.RECOGNISE}:
            names += ["part_problem"]
        work = split(self.machine.state)[1]
        if effect is Effect.UNSUSPEND and joined("execute", work) not in LOOKED_FOR | {
            "completing"
        }:
            names += ["part_dropped"]
        decision = self.take(Event(data.draw(st.sampled_from(names))), effect)
        assert decision.answer == "handled", decision

    @rule()
    def the_line_of_the_arm_is_cut(self) -> None:
        if self.work is not None and self.work is not Effect.ABORT_MOTION:
            assert self.take(Event.FAULT, self.work).target == "aborting"

    @invariant()
    def somebody_always_knows_what_comes_next(self) -> None:
        # nothing waits for an outcome that no effect is left to report
        state = self.machine.state
        mode, _ = split(state)
        if state in EFFECTS or mode in ("suspending", "suspended", "unsuspending"):
            assert self.work is not None or state == "held", state
        if mode in MODE_EFFECTS:
            assert self.pause is not None, state
        else:
            assert self.pause is None, state

    @invariant()
    def at_rest_nothing_may_move(self) -> None:
        if self.machine.state in NO_PERMIT or split(self.machine.state)[0] == "suspended":
            assert not self.permit

    @invariant()
    def from_every_state_a_stop_leads_to_rest(self) -> None:
        assert stopped_from(self.machine.state) in {"stopped", "aborted", "complete"}


Cell.TestCase.settings = settings(max_examples=60, stateful_step_count=60, deadline=None)
TestCell = Cell.TestCase


def test_what_permits_and_what_forbids_is_as_listed() -> None:
    assert {event.value for event in PERMITTING} == PERMIT
    assert set(FORBIDDING) == NO_PERMIT | {s for s in STATES if split(s)[0] == "suspended"}


def test_a_pause_keeps_the_grasp_and_a_step_goes_on_with_it() -> None:
    machine = at("execute_grasping")
    script: list[tuple[Event, str, tuple[Effect, ...]]] = [
        (Event.PAUSE_AT_SAFE_POINT, "suspending_grasping", (Effect.SUSPEND,)),
        (Event.PAUSE_NOW, "suspending_grasping", ()),
        (Event.PAUSED, "suspended_grasping", ()),
        (Event.STEP, "unsuspending_grasping", (Effect.UNSUSPEND,)),
        (Event.STEP_BEGUN, "suspending_grasping", (Effect.SUSPEND,)),
        (Event.GRASPED, "suspending_presenting", (Effect.PRESENT,)),
        (Event.PAUSED, "suspended_presenting", ()),
        (Event.RESUME, "unsuspending_presenting", (Effect.UNSUSPEND,)),
        (Event.PART_DROPPED, "suspended_withdrawing", (Effect.WITHDRAW,)),
        (Event.RESUME, "unsuspending_withdrawing", (Effect.UNSUSPEND,)),
        (Event.RESUMED, "execute_withdrawing", ()),
        (Event.WITHDRAWN, "execute_acquiring", (Effect.ACQUIRE,)),
    ]
    for event, target, effects in script:
        decision = machine.dispatch(event)
        assert (decision.target, decision.effects) == (target, effects), event
