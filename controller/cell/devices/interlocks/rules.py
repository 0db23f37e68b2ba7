"""The interlock rules: those of every cell, those of its file, and the first one violated."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from controller.config.conditions import Condition, read_condition
from controller.config.interlock_rules import FACTS, InterlockRuleSection
from messages import joined, key, say

from .logic import Truth, truth_of

Facts = Mapping[str, Truth]
GUARD: Final = "guard_closed"


class CheckTime(StrEnum):
    """The time at which a rule is checked."""

    ADMIT = "admit"
    """Before a motion of the arm or of jaws."""
    DURING = "during"
    """While anything may move."""
    RECOVER = key("recover")
    """Before a gripper is opened for a person who holds the part."""


@dataclass(frozen=True, slots=True)
class Rule:
    """While `when` is true or unknown, `require` must be true.

    Attributes
    ----------
    name : for messages
    when, require : conditions over the facts
    checks : times at which it is checked
    admits_unknown : a requirement that is neither known to be true nor false is let pass
    holds : a violation holds the run until a person acknowledges it; it does not end the run
    words : event, and what to do about it
    code : code of its alarm
    """

    name: str
    when: Condition
    require: Condition
    checks: frozenset[CheckTime]
    words: str
    code: str
    admits_unknown: bool = False
    holds: bool = False


STALE: Final = "inputs_stale"  # code of the alarm


@dataclass(frozen=True, slots=True)
class Violation:
    """A rule that does not hold.

    Attributes
    ----------
    rule : rule that was violated
    value : value of its requirement: false, or unknown
    unknown : facts of the requirement that are not known
    """

    rule: Rule
    value: Truth
    unknown: tuple[str, ...]

    @property
    def code(self) -> str:
        """The code of its alarm. An unknown input is no pressed emergency stop."""
        is_stale = self.value is Truth.UNKNOWN and REQUIRED_SIGNALS.keys() & set(self.unknown)
        return STALE if is_stale else self.rule.code

    @property
    def message(self) -> str:
        """The event, and what to do about it, for the operator."""
        name = next(iter(sorted(self.rule.require.names())), self.rule.name)
        if self.value is Truth.FALSE:
            return say(
                "{name}: {words}",
                name=name if name in REQUIRED_SIGNALS else self.rule.name,
                words=self.rule.words,
            )
        missing = joined(" and ", self.unknown)
        return say(
            "{missing}: the I/O block has no fresh reading, which counts as "
            "not healthy; check its cable and power, and `cellctl doctor` for "
            "what it answers",
            missing=missing,
        )


def _rule(
    name: str,
    require: str,
    words: str,
    *,
    when: str = "always",
    checks: Iterable[CheckTime] = CheckTime,
    holds: bool = False,
) -> Rule:
    return Rule(
        name=name,
        when=read_condition(when, FACTS),
        require=read_condition(require, FACTS),
        checks=frozenset(checks),
        words=words,
        code=name,
        holds=holds,
    )


BUILT_IN_RULES: Final = (
    _rule(
        "estop",
        "estop_ok",
        key("the emergency stop is pressed, or its chain is open; release and reset it"),
    ),
    _rule(
        "guard_closed", GUARD, key("the door is open; close it"), when="!person_inside", holds=True
    ),
    _rule("supply", "supply_ok", key("the 24 V supply is missing; check the fuse")),
    _rule(
        "hand_off_blocked",
        "fixed_gripper_free | custody_in_fixed | custody_in_both | custody_lost",
        key("the fixed gripper is closed on something other than the part; check what it holds"),
        when="moves_arm & near_hand_off",
        checks=(CheckTime.ADMIT,),
    ),
)
# What to do about each safety copy that every motion requires.
REQUIRED_SIGNALS: Final[Mapping[str, str]] = {
    name: rule.words
    for rule in BUILT_IN_RULES
    if CheckTime.DURING in rule.checks
    for name in rule.require.names()
}


def rules_of(sections: Mapping[str, InterlockRuleSection]) -> tuple[Rule, ...]:
    """Return the rules of a cell: those of every cell, then those of its file."""
    own = (
        Rule(
            name=name,
            when=read_condition(section.when, FACTS),
            require=read_condition(section.require, FACTS),
            checks=frozenset(map(CheckTime, section.check)),
            words=section.words,
            code="interlock",
            admits_unknown=section.on_unknown == "admit",
            holds=section.then == "hold",
        )
        for name, section in sections.items()
    )
    return (*BUILT_IN_RULES, *own)


def first_violation(rules: Iterable[Rule], check: CheckTime, facts: Facts) -> Violation | None:
    """Return the first rule that does not hold; None if all do.

    Parameters
    ----------
    rules : rules of the cell
    check : kinds of checks due now
    facts : known facts; a fact that is not given is unknown
    """
    for rule in rules:
        if check not in rule.checks or truth_of(rule.when, facts) is Truth.FALSE:
            continue
        value = truth_of(rule.require, facts)
        if value is Truth.TRUE or (value is Truth.UNKNOWN and rule.admits_unknown):
            continue
        names = sorted(rule.require.names())
        unknown = tuple(n for n in names if facts.get(n, Truth.UNKNOWN) is Truth.UNKNOWN)
        return Violation(rule, value, unknown)
    return None
