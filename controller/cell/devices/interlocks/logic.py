"""Kleene's three-valued logic: an unknown fact is neither true nor false.

``and`` is the smaller of its parts and ``or`` the larger, in the order false, unknown, true. So an
unknown fact decides nothing that the others do not decide without it.
"""

from collections.abc import Mapping
from enum import IntEnum

from controller.config.conditions import Condition
from drivers.kinds import Signal


class Truth(IntEnum):
    """A value of the logic, in its order."""

    FALSE = 0
    UNKNOWN = 1
    TRUE = 2

    def __invert__(self) -> "Truth":
        """Return its denial; that of the unknown is unknown."""
        return Truth(2 - self)

    @classmethod
    def of(cls, claim: bool | None) -> "Truth":
        """Return the value of a claim; None is unknown."""
        if claim is None:
            return cls.UNKNOWN
        return cls.TRUE if claim else cls.FALSE

    @classmethod
    def of_signal(cls, signal: Signal) -> "Truth":
        """Return the value of an input of the I/O block."""
        by_signal = {Signal.OK: cls.TRUE, Signal.NOT_OK: cls.FALSE}
        return by_signal.get(signal, cls.UNKNOWN)


def truth_of(condition: Condition, facts: Mapping[str, Truth]) -> Truth:
    """Return the value of a condition; a missing fact is unknown."""
    match condition.op:
        case "fact":
            return facts.get(condition.name, Truth.UNKNOWN)
        case "not":
            return ~truth_of(condition.parts[0], facts)
        case "and":
            return min(truth_of(part, facts) for part in condition.parts)
        case "or":
            return max(truth_of(part, facts) for part in condition.parts)
