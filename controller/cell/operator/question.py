"""The models of a question and an answer, and of the operator who decides."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

ACK: Final = "ack"  # word to type for an acknowledgement


@dataclass(frozen=True, slots=True)
class Choice:
    """One answer that may be given.

    Attributes
    ----------
    key : word to type, a single one
    words : action of the cell then
    """

    key: str
    words: str


@dataclass(frozen=True, slots=True)
class Question:
    """A decision that the cell needs before it goes on; nothing moves until it is answered.

    Attributes
    ----------
    code : stable short name, as in the manual
    text : event, and what is unknown
    choices : the possible answers
    preview : first motion after each choice that moves something, by the choice's key: target,
        distance, speed
    entry : entry allowed in place of a choice, such as a serial number; empty for none
    check : returns why a typed text is no answer; empty if it is one
    """

    code: str
    text: str
    choices: tuple[Choice, ...]
    preview: tuple[tuple[str, str], ...] = ()
    entry: str = ""
    check: Callable[[str], str] = lambda _: ""


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer.

    Attributes
    ----------
    key : key of the choice
    who : name of the person who decided, and the place
    why : the reason given; empty without one
    """

    key: str
    who: str
    why: str = ""


class Operator(Protocol):
    """A person or program that can decide."""

    async def decide(self, question: Question) -> Answer | None:
        """Return the answer, journaled as a decision; None if nobody is there to give one.

        The person who answers has been shown the question's text.
        """
        ...


class Nobody:
    """A cell that runs unattended: no question is answered."""

    async def decide(self, question: Question) -> Answer | None:
        """Return None."""
        return None


NOBODY: Final = Nobody()
