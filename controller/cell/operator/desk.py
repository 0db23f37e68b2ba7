"""The desk for questions: one at a time, answered by the first person to do so."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from messages import key, say

from .question import Answer, Question


@dataclass(frozen=True, slots=True)
class OpenQuestion:
    """A question that nobody has answered yet; `number` counts from 1 in a run."""

    number: int
    question: Question


class Desk:
    """An operator who may answer from several places.

    Parameters
    ----------
    is_attended : somebody is there, or will come; otherwise no question is raised
    on_change : called with the open question, and with None once it is answered
    """

    def __init__(
        self,
        *,
        is_attended: bool,
        on_change: Callable[[OpenQuestion | None], None] = lambda question: None,
    ) -> None:
        self._is_attended = is_attended
        self._on_change = on_change
        self._number = 0
        self._open: tuple[OpenQuestion, asyncio.Future[Answer | None]] | None = None

    @property
    def open(self) -> OpenQuestion | None:
        """The question that waits for its answer."""
        return None if self._open is None else self._open[0]

    @property
    def is_answered(self) -> bool:
        """Whether the open question has its answer already."""
        return self._open is not None and self._open[1].done()

    async def decide(self, question: Question) -> Answer | None:
        """Return the answer once there is one; None at once if nobody is there to give it."""
        if not self._is_attended:
            return None
        self._number += 1
        raised = OpenQuestion(self._number, question)
        answered: asyncio.Future[Answer | None] = asyncio.get_running_loop().create_future()
        self._open = raised, answered
        self._on_change(raised)
        try:
            answer = await answered
        finally:
            self._open = None
            self._on_change(None)
        return answer

    def leave(self) -> None:
        """Note that nobody is there from now on: an open question ends without an answer."""
        self._is_attended = False
        if self._open is not None and not self._open[1].done():
            self._open[1].set_result(None)

    def answer(self, number: int | None, answer: Answer) -> str:
        """Give an answer; return why it does not count, empty if it does.

        Parameters
        ----------
        number : number of the question that was seen; None for the one that is open
        answer : one of its choices, or a text where one is asked for; who gives it and why
        """
        if self._open is None or self._open[1].done():
            return key("there is no question to answer")
        raised, answered = self._open
        if number not in (None, raised.number):
            return say(
                "question {number} is not open any more; question {open_number} is",
                number=number,
                open_number=raised.number,
            )
        keys = [choice.key for choice in raised.question.choices]
        if answer.key not in keys and raised.question.entry:
            refusal = raised.question.check(answer.key)
            if refusal:
                return refusal
        elif answer.key not in keys:
            return say(
                "`{key}` is no answer to question {number}: {keys}",
                key=answer.key,
                number=raised.number,
                keys=", ".join(keys),
            )
        answered.set_result(answer)
        return ""
