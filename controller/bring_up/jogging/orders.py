"""The orders of a jog, in words; a key stands for such words, too."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import Final

from controller.cell.errors import CellError
from messages import key

MAX_DEG: Final = 45.0
MAX_MM: Final = 100.0
STEPS: Final = ((1.0, 0.2), (5.0, 1.0), (20.0, 5.0))  # mm, degrees; by their number from 1
MAX_SPEED_PERCENT: Final = 25.0  # in percent of the usual speed
SHIFTS: Final = ("x", "y", "z", "advance")
TURNS: Final = ("heading", "tilt", "spin")
GRIPPERS: Final = ("arm", "fixed")


class Verb(StrEnum):
    """The kind of an order."""

    HOME = "home"
    MOTOR = "motor"
    JOINT = "joint"
    SHIFT = "shift"
    TURN = "turn"
    PARK = key("park")
    OPEN = "open"
    CLOSE = "close"
    LAMP = "lamp"
    STEP = key("step")
    SPEED = "speed"
    SHOW = "show"
    STOP = key("stop")
    TAKE = "take"
    QUIT = "quit"


GRAMMAR: Final = (
    "home | motor NAME | joint NUMBER BY | x|y|z|advance BY | heading|tilt|spin BY | park | "
    "open arm|fixed [MM] | close arm|fixed | lamp NAME on|off | step 1|2|3 | speed PERCENT | "
    "show | stop | take | quit; BY is mm or degrees, or + or - for one step"
)


class WrongOrderError(CellError):
    """An order that cannot be understood; nothing has moved."""


@dataclass(frozen=True, slots=True)
class JogOrder:
    """One order.

    Attributes
    ----------
    verb : action of the key
    what : motor, joint, direction, gripper or lamp
    amount : mm, degrees, percent or a number; None if none was given
    sign : sign of one step, where no amount was given
    """

    verb: Verb
    what: str = ""
    amount: float | None = None
    sign: int = 1

    def by(self, step: float) -> float:
        """Return the amount, one step of this size if none was given."""
        return self.sign * step if self.amount is None else self.amount


def read_order(text: str) -> JogOrder:
    """Return the order parsed from a line.

    Raises
    ------
    WrongOrderError : it states none
    """
    words = text.lower().split()
    if not words:
        raise WrongOrderError("an empty order")
    head, rest = words[0], words[1:]
    if head in SHIFTS:
        return _moving(text, Verb.SHIFT, head, rest, MAX_MM)
    if head in TURNS:
        return _moving(text, Verb.TURN, head, rest, MAX_DEG)
    if head not in {verb.value for verb in Verb} - {Verb.SHIFT, Verb.TURN}:
        raise WrongOrderError(f"`{text:.60}` is no order; the orders are: {GRAMMAR}")
    verb = Verb(head)
    if verb is Verb.JOINT and len(rest) == 2 and rest[0].isdigit():
        return _moving(text, verb, rest[0], rest[1:], MAX_MM)
    if verb is Verb.OPEN and len(rest) == 2 and rest[0] in GRIPPERS:
        return JogOrder(verb, rest[0], _number(text, rest[1], 0.0, 1000.0))
    if verb in (Verb.OPEN, Verb.CLOSE) and len(rest) == 1 and rest[0] in GRIPPERS:
        return JogOrder(verb, rest[0])
    if verb is Verb.LAMP and len(rest) == 2 and rest[1] in ("on", "off"):
        return JogOrder(verb, rest[0], float(rest[1] == "on"))
    if verb is Verb.MOTOR and len(rest) == 1:
        return JogOrder(verb, rest[0])
    if verb is Verb.STEP and len(rest) == 1:
        number = _number(text, rest[0], 1, len(STEPS))
        if not number.is_integer():
            raise WrongOrderError(f"`{text:.60}`: steps are numbered 1 to {len(STEPS)}")
        return JogOrder(verb, "", number)
    if verb is Verb.SPEED and len(rest) == 1:
        return JogOrder(verb, "", _number(text, rest[0], 1.0, MAX_SPEED_PERCENT))
    if verb in _ALONE and not rest:
        return JogOrder(verb)
    raise WrongOrderError(f"`{text:.60}` has too few or too many words: {GRAMMAR}")


_ALONE: Final = frozenset({Verb.HOME, Verb.PARK, Verb.SHOW, Verb.STOP, Verb.TAKE, Verb.QUIT})


def _moving(text: str, verb: Verb, what: str, rest: Sequence[str], most: float) -> JogOrder:
    if len(rest) != 1:
        raise WrongOrderError(f"`{text:.60}`: by how much? {GRAMMAR}")
    if rest[0] in ("+", "-"):
        return JogOrder(verb, what, None, 1 if rest[0] == "+" else -1)
    return JogOrder(verb, what, _number(text, rest[0], -most, most))


def _number(text: str, word: str, low: float, high: float) -> float:
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or not low <= value <= high:
        raise WrongOrderError(f"`{text:.60}`: a number from {low:g} to {high:g} is required")
    return value
