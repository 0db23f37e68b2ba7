"""Interlocks as data: logic of three values, conditions, rules, and what they admit."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from config_text import CELL_TEXT
from hypothesis import given
from hypothesis import strategies as st

from controller.cell.alarms import BY_CODE
from controller.cell.batch.watching import InterlockWatcher
from controller.cell.custody import Custody
from controller.cell.devices.interlocks import (
    BUILT_IN_RULES,
    CheckTime,
    Truth,
    check_interlocks,
    first_violation,
    rules_of,
    truth_of,
)
from controller.cell.errors import InterlockError
from controller.cell.machine import Event
from controller.cell.services import Interlocks, Retries, fault_policy
from controller.config import ConfigError, FaultsSection, load_cell
from controller.config.conditions import Condition, read_condition
from controller.config.interlock_rules import BUILT_IN
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from drivers.kinds import Signal

ROOT = Path(__file__).parents[2]
LAYOUT = build_layout(load_cell(ROOT / "recipes/cells/emulated.yaml"))
NAMES = ("a", "b", "c")
T, U, F = Truth.TRUE, Truth.UNKNOWN, Truth.FALSE

# --- the logic ------------------------------------------------------------------------------------


def conditions() -> st.SearchStrategy[Condition]:
    facts = st.sampled_from(NAMES).map(lambda name: Condition("fact", name))
    return st.recursive(
        facts,
        lambda inner: st.one_of(
            inner.map(lambda one: Condition("not", parts=(one,))),
            st.lists(inner, min_size=2, max_size=3).map(lambda p: Condition("and", parts=(*p,))),
            st.lists(inner, min_size=2, max_size=3).map(lambda p: Condition("or", parts=(*p,))),
        ),
        max_leaves=8,
    )


def plainly(condition: Condition, claims: dict[str, bool]) -> bool:
    """Evaluate in the logic of two values, by Python's own words."""
    if condition.op == "fact":
        return claims[condition.name]
    values = [plainly(part, claims) for part in condition.parts]
    if condition.op == "not":
        return not values[0]
    return all(values) if condition.op == "and" else any(values)


VALUES = st.dictionaries(st.sampled_from(NAMES), st.sampled_from(Truth), min_size=3)


@given(conditions(), VALUES)
def test_what_is_decided_holds_however_the_unknown_facts_turn_out(
    condition: Condition, facts: dict[str, Truth]
) -> None:
    value = truth_of(condition, facts)
    open_names = [name for name in NAMES if facts[name] is U]
    outcomes = set()
    for bits in range(2 ** len(open_names)):
        claims = {name: facts[name] is T for name in NAMES}
        claims |= {name: bool(bits >> i & 1) for i, name in enumerate(open_names)}
        outcomes.add(plainly(condition, claims))
    if value is not U:
        assert outcomes == {value is T}
    if not open_names:
        assert value is not U


@given(conditions(), VALUES, st.sampled_from(NAMES), st.sampled_from((T, F)))
def test_more_knowledge_never_takes_a_decision_back(
    condition: Condition, facts: dict[str, Truth], name: str, learnt: Truth
) -> None:
    before = truth_of(condition, {**facts, name: U})
    if before is not U:
        assert truth_of(condition, {**facts, name: learnt}) is before


@given(st.sampled_from(Truth), st.sampled_from(Truth))
def test_de_morgans_laws_hold(a: Truth, b: Truth) -> None:
    facts = {"a": a, "b": b}
    pairs = (("!(a & b)", "!a | !b"), ("!(a | b)", "!a & !b"), ("!!a", "a"))
    for left, right in pairs:
        assert truth_of(read_condition(left, NAMES), facts) is truth_of(
            read_condition(right, NAMES), facts
        )


def test_a_fact_that_nobody_gives_is_unknown() -> None:
    assert truth_of(read_condition("a | b", NAMES), {"b": F}) is U
    assert truth_of(read_condition("a | b", NAMES), {"b": T}) is T


# --- conditions as texts --------------------------------------------------------------------------


def text_of(condition: Condition) -> str:
    if condition.op == "fact":
        return condition.name
    if condition.op == "not":
        return f"!({text_of(condition.parts[0])})"
    sign = " & " if condition.op == "and" else " | "
    return sign.join(f"({text_of(part)})" for part in condition.parts)


@given(conditions(), VALUES)
def test_a_condition_is_read_as_it_is_written(
    condition: Condition, facts: dict[str, Truth]
) -> None:
    assert truth_of(read_condition(text_of(condition), NAMES), facts) is truth_of(condition, facts)


def test_and_binds_stronger_than_or_and_not_strongest() -> None:
    facts = {"a": T, "b": F, "c": F}
    assert truth_of(read_condition("a | b & c", NAMES), facts) is T
    assert truth_of(read_condition("(a | b) & c", NAMES), facts) is F
    assert truth_of(read_condition("!b & a", NAMES), facts) is T


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "the name of a fact is missing"),
        ("a &", "the name of a fact is missing"),
        ("a b", "`b` is not expected"),
        ("(a", "a bracket is not closed"),
        ("a == b", "'== b' is no part of a condition"),
        ("estop_o", "unknown fact `estop_o`; did you mean `estop_ok`"),
        ("!" * 300 + "a", "more than 20 levels"),
        ("(" * 150 + "a", "more than 20 levels"),
        ("a | " * 200 + "a", "at most 400 characters"),
    ],
)
def test_what_is_no_condition_is_refused_with_the_reason(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=r".") as refused:
        read_condition(text, (*NAMES, "estop_ok"))
    assert sentence in str(refused.value)


# --- rules ----------------------------------------------------------------------------------------


def cell_with(tmp_path: Path, rules: str) -> Path:
    path = tmp_path / "cell.yaml"
    path.write_text(f"{CELL_TEXT}\ninterlock_rules:\n{rules}", encoding="utf-8")
    return path


NEST = (
    "  nest_empty: {when: moves_arm, require: '!part_in_nest', check: [admit],\n"
    "               words: 'a part is in the nest; take it out'}\n"
)


def test_every_rule_has_an_alarm_and_every_rule_of_the_house_its_own() -> None:
    assert {rule.code for rule in BUILT_IN_RULES} == set(BUILT_IN) <= set(BY_CODE)


def test_a_cell_file_adds_rules_and_cannot_weaken_those_of_the_house(tmp_path: Path) -> None:
    rules = rules_of(load_cell(cell_with(tmp_path, NEST)).interlock_rules)
    assert [rule.name for rule in rules] == [*BUILT_IN, "nest_empty"]
    with pytest.raises(ConfigError, match="`estop` is a rule of every cell"):
        load_cell(cell_with(tmp_path, "  estop: {require: always, words: 'never mind'}\n"))


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        ("{require: air_ok, words: 'no air'}", "unknown fact `air_ok`"),
        ("{require: 'supply_ok &', words: 'no supply'}", "the name of a fact is missing"),
        ("{require: supply_ok, check: [], words: 'no supply'}", "at least one of admit"),
        ("{require: supply_ok, on_unknown: ignore, words: 'x yz'}", "on_unknown"),
    ],
)
def test_a_rule_that_means_nothing_is_refused_with_its_line(
    tmp_path: Path, rule: str, sentence: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        load_cell(cell_with(tmp_path, f"  mine: {rule}\n"))
    assert sentence in str(refused.value)
    assert "cell.yaml:" in str(refused.value)


@pytest.mark.parametrize(
    ("value", "on_unknown", "is_refused"),
    [(T, "refuse", False), (F, "refuse", True), (U, "refuse", True), (U, "admit", False),
     (F, "admit", True)],
)  # fmt: skip
def test_the_unknown_refuses_unless_the_rule_admits_it(
    tmp_path: Path, value: Truth, on_unknown: str, is_refused: bool
) -> None:
    text = f"  mine: {{require: acknowledge, on_unknown: {on_unknown}, words: 'press it'}}\n"
    (mine,) = rules_of(load_cell(cell_with(tmp_path, text)).interlock_rules)[len(BUILT_IN) :]
    found = first_violation([mine], CheckTime.ADMIT, {"acknowledge": value, "always": T})
    assert (found is not None) is is_refused


def test_a_rule_whose_occasion_is_unknown_is_checked_all_the_same() -> None:
    (rule,) = [r for r in BUILT_IN_RULES if r.name == "hand_off_blocked"]
    held = {"custody_in_fixed": F, "custody_in_both": F, "custody_lost": F}
    facts = {"moves_arm": T, "fixed_gripper_free": F, **held}
    assert first_violation([rule], CheckTime.ADMIT, facts) is not None
    assert first_violation([rule], CheckTime.ADMIT, {**facts, "near_hand_off": F}) is None


@pytest.mark.parametrize("signal", [Signal.NOT_OK, Signal.UNKNOWN])
def test_only_a_person_may_have_the_door_open(signal: Signal) -> None:
    io: Any = SimpleNamespace(signal=lambda name: signal if name == "guard_closed" else Signal.OK)
    with pytest.raises(InterlockError, match="guard_closed: ") as refused:
        check_interlocks(io)
    known = signal is Signal.NOT_OK
    assert refused.value.code == ("guard_closed" if known else "inputs_stale")
    check_interlocks(io, is_person_inside=True)


# --- what they admit ------------------------------------------------------------------------------


def near() -> np.ndarray:
    """Return a configuration with the TCP within reach of the fixed gripper's jaws."""
    q = LAYOUT.arm.spread(np.random.default_rng(1).uniform(size=(20_000, 6)))
    gap_mm = LAYOUT.arm.forward(q)[:, :3, 3] - LAYOUT.T_world_fixed_tcp[:3, 3]
    return np.asarray(q[np.argmin(np.linalg.norm(gap_mm, axis=1))])


class Cell:
    """What the rules ask about."""

    max_opening_mm = 85.0

    def __init__(self, **status: Any) -> None:
        self.custody = Custody.IN_ARM
        self.off: dict[str, Signal] = {}
        self.found = SimpleNamespace(
            **{"opening_mm": 60.0, "is_moving": False, "has_contact": False, **status}
        )
        self.asked = 0

    async def status(self) -> Any:
        self.asked += 1
        return self.found

    def signal(self, name: str) -> Signal:
        return self.off.get(name, Signal.OK)


def interlocks_of(cell: Any, rules: Any = BUILT_IN_RULES) -> Interlocks:
    record: Any = SimpleNamespace()
    retries = Retries(record, lambda: fault_policy(FaultsSection()), CellClock(1000.0))
    return Interlocks(cell, cell, LAYOUT, lambda: cell.custody, retries, rules)


@pytest.mark.parametrize(
    ("status", "custody", "is_admitted"),
    [
        ({}, Custody.IN_ARM, True),
        ({"has_contact": True}, Custody.IN_ARM, False),
        ({"has_contact": True}, Custody.IN_FIXED, True),
        ({"has_contact": True}, Custody.IN_BOTH, True),
        ({"has_contact": True}, Custody.UNKNOWN, False),
        ({"has_contact": True}, Custody.LOST, True),  # the arm is about to leave
        ({"is_moving": True}, Custody.IN_ARM, False),
        ({"has_contact": True, "opening_mm": 84.5}, Custody.IN_ARM, True),  # on its own end
    ],
)
async def test_the_arm_comes_near_the_fixed_gripper_only_where_that_is_free_or_has_the_part(
    status: dict[str, Any], custody: Custody, is_admitted: bool
) -> None:
    cell = Cell(**status)
    cell.custody = custody
    path = (near(),)
    if is_admitted:
        await interlocks_of(cell).admit_path(path)
        return
    with pytest.raises(InterlockError) as refused:
        await interlocks_of(cell).admit_path(path)
    assert refused.value.code == "hand_off_blocked"


async def test_far_from_the_fixed_gripper_nobody_asks_it() -> None:
    cell = Cell(has_contact=True)
    await interlocks_of(cell).admit_path((LAYOUT.park_q,))
    assert cell.asked == 0


async def test_jaws_do_not_move_either_while_a_safety_copy_is_not_known_to_be_healthy() -> None:
    cell = Cell()
    cell.off["estop_ok"] = Signal.UNKNOWN
    with pytest.raises(InterlockError, match="no fresh reading") as refused:
        interlocks_of(cell).admit_jaws()
    assert refused.value.code == "inputs_stale"  # nobody has pressed anything


async def test_a_rule_of_the_cell_file_holds_at_admission_and_during_motion(tmp_path: Path) -> None:
    text = NEST.replace("[admit]", "[admit, during]")
    rules = rules_of(load_cell(cell_with(tmp_path, text)).interlock_rules)
    cell = Cell()
    interlocks = interlocks_of(cell, rules)
    cell.off["part_in_nest"] = Signal.NOT_OK
    await interlocks.admit_path((LAYOUT.park_q,))
    reported: list[tuple[str, str]] = []

    class Changes:
        def __enter__(self) -> Any:
            return self

        def __exit__(self, *_: object) -> None: ...

        async def __aiter__(self) -> Any:
            for name, signal in (
                ("acknowledge", Signal.NOT_OK),  # no rule is about it
                ("part_in_nest", Signal.OK),
                ("guard_closed", Signal.NOT_OK),
            ):
                yield SimpleNamespace(name=name, signal=signal)

    def report(event: Event, message: str = "", code: str = "") -> None:
        held = code == "guard_closed"
        assert event is (Event.GUARD_OPENED if held else Event.FAULT)
        reported.append((message, code))

    io: Any = SimpleNamespace(watch=Changes)
    await InterlockWatcher(io, interlocks).run(report)
    assert reported == [
        ("nest_empty: a part is in the nest; take it out", "interlock"),
        ("guard_closed: the door is open; close it", "guard_closed"),
    ]
    cell.off["part_in_nest"] = Signal.OK
    with pytest.raises(InterlockError, match="take it out"):
        await interlocks.admit_path((LAYOUT.park_q,))
