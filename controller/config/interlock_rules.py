"""The section `interlock_rules` of a cell file: rules beside those of every cell."""

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from .conditions import read_condition
from .yaml_models import Section

# Inputs of the I/O block, by the names that messages have for them.
SIGNALS: Final = (
    "estop_ok", "guard_closed", "supply_ok", "part_in_nest", "part_in_gripper", "acknowledge",
)  # fmt: skip
# States that the cell knows of itself.
STATES: Final = (
    "always", "moves_arm", "moves_jaws", "near_hand_off", "person_inside", "fixed_gripper_free",
    "custody_on_table", "custody_in_arm", "custody_in_fixed", "custody_in_both", "custody_placed",
    "custody_lost",
)  # fmt: skip
FACTS: Final = (*SIGNALS, *STATES)
# The rules that every cell has; a cell file can add rules, not weaken these.
BUILT_IN: Final = ("estop", "guard_closed", "supply", "hand_off_blocked")


def _condition(text: str) -> str:
    read_condition(text, FACTS)
    return text


ConditionText = Annotated[str, AfterValidator(_condition)]


class InterlockRuleSection(Section):
    """One rule: while `when` is true or unknown, `require` must be true.

    Attributes
    ----------
    when, require : conditions over the facts
    check : before a motion, during it, before a person's gripper is opened
    on_unknown : reaction to a requirement whose truth is unknown
    then : reaction of the run to a violation during a motion: it ends, or is held as by an open
        door
    words : event, and what to do about it
    """

    when: ConditionText = "always"
    require: ConditionText
    check: tuple[Literal["admit", "during", "recover"], ...] = ("admit", "during")
    on_unknown: Literal["refuse", "admit"] = "refuse"
    then: Literal["end", "hold"] = "end"
    words: str = Field(min_length=4, max_length=200)

    @model_validator(mode="after")
    def _is_checked_some_time(self) -> "InterlockRuleSection":
        if not self.check:
            raise ValueError("`check` must name at least one of admit, during, recover")
        return self


def _not_built_in(
    rules: dict[str, InterlockRuleSection],
) -> dict[str, InterlockRuleSection]:
    for name in rules:
        if name in BUILT_IN:
            raise ValueError(f"`{name}` is a rule of every cell; add one with another name")
    return rules


InterlockRules = Annotated[
    dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")], InterlockRuleSection],
    AfterValidator(_not_built_in),
]
