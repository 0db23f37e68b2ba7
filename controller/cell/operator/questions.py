"""The question about each problem with a part, and the effect of each answer. Data alone.

The codes are those of `PartProblemError`. A choice that moves something names the first motion.
"""

from collections.abc import Mapping
from typing import Final

from messages import key, say

from .question import Choice, Question

LOOK: Final = "look"
OUT: Final = "out"
STOP: Final = "stop"

# The problem of a cell that has not been homed; looking again means to reset it again.
NOT_EMPTY: Final = "fixture_not_empty"
# The problem of a tray without a free nest; looking again means to state that it is empty.
TRAY_FULL: Final = "tray_full"
# The problem of a part whose number nobody read; looking again means to ask for it again.
NO_SERIAL: Final = "no_serial"

_STOP: Final = Choice(STOP, key("end the run; nothing is released"))
_OUT: Final = Choice(
    OUT,
    key("I took the part out of the cell: check that both grippers are empty, then the next part"),
)
_AWAY: Final = Choice(OUT, key("I took the part off the table: go on with the next part"))
# Ways back to the work where the part is on the table, or should be.
_ON_TABLE: Final[Mapping[str, str]] = {
    "no_part": key("I have laid a part on the table: take new pictures"),
    "many_parts": key("the table is cleared up, or parts lie further apart: take new pictures"),
    "unknown_object": key("the table is cleared up: take new pictures"),
    "part_cut_off": key("the part is inside the backlit area now: take new pictures"),
    "wrong_part": key("the right part is on the table now: take new pictures"),
    "no_plan": key("I have laid the part another way up: take new pictures"),
}
_ASKS: Final = key("The part is not where it should be. Is it on the table?")
# First motion after a choice that moves something.
_FIRST: Final[Mapping[str, str]] = {
    LOOK: (
        key(
            "the arm goes back along its own path and parks, unless it is parked already; then the "
            "cell takes pictures"
        )
    ),
    OUT: key("the arm gripper presses, to check that it is empty; then the arm parks"),
}
# The same of a cell that has not been homed.
_FIRST_UNHOMED: Final[Mapping[str, str]] = {
    LOOK: key(
        "nothing while the fixed gripper holds something; else the arm homes, which sweeps its "
        "whole reach, and both grippers open"
    ),
}
# The same with an arm of absolute encoders.
_FIRST_NOT_PARKED: Final[Mapping[str, str]] = {
    LOOK: key(
        "nothing while the fixed gripper holds something; else both grippers open, and the arm "
        "goes to park"
    ),
}


def question_for(code: str, message: str, custody: str, *, sweeps_to_home: bool = True) -> Question:
    """Return the question to the operator about a problem.

    Parameters
    ----------
    code : code of the problem
    message : the problem, as the operator reads it
    custody : gripper, tray or table with the part, as far as it is known
    sweeps_to_home : whether the arm moves its joints to find their references
    """
    choices: tuple[Choice, ...]
    if code in _ON_TABLE:
        text = say("{message}.", message=message)
        choices = (Choice(LOOK, _ON_TABLE[code]), _AWAY, _STOP)
    elif code == NO_SERIAL:
        text = say("{message}.", message=message)
        choices = (Choice(LOOK, key("the scanner is ready: read the next number")), _STOP)
    elif code == TRAY_FULL:
        text = say("{message}.", message=message)
        choices = (Choice(LOOK, key("they are empty now: go on with the next part")), _STOP)
    elif code == NOT_EMPTY:
        text = say("{message}. The cell has not been homed.", message=message)
        choices = (Choice(LOOK, key("I took it out: look at the fixed gripper again")), _STOP)
    else:
        text = say(
            "{message}. {asks} (by the journal: {custody})",
            message=message,
            asks=_ASKS,
            custody=custody,
        )
        choices = (
            Choice(LOOK, key("it is on the table, or may be: look at the table again")),
            _OUT,
            _STOP,
        )
    first = _FIRST
    if code == NOT_EMPTY:
        first = _FIRST_UNHOMED if sweeps_to_home else _FIRST_NOT_PARKED
    return Question(
        code=code,
        text=text,
        choices=choices,
        preview=tuple((one.key, first[one.key]) for one in choices if one.key in first),
    )
