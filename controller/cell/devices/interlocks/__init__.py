"""Interlocks as data: conditions for motion, in three-valued logic.

`logic.py` is the logic, `rules.py` the rules of every cell and of a cell file, `checks.py` the
checks of the safety copies that need nothing but the I/O block.
"""

from .checks import check_interlocks, settled_signal
from .logic import Truth, truth_of
from .rules import (
    BUILT_IN_RULES,
    GUARD,
    REQUIRED_SIGNALS,
    CheckTime,
    Facts,
    Rule,
    Violation,
    first_violation,
    rules_of,
)

__all__ = [
    "BUILT_IN_RULES",
    "GUARD",
    "REQUIRED_SIGNALS",
    "CheckTime",
    "Facts",
    "Rule",
    "Truth",
    "Violation",
    "check_interlocks",
    "first_violation",
    "rules_of",
    "settled_signal",
    "truth_of",
]
