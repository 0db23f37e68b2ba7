"""Questions and answers as rows of the journal, for any operator."""

from ..journal import Journal
from ..journal.rows import QuestionAnswered, QuestionRaised
from .question import Answer, Operator, Question


class Journaled:
    """An operator whose questions and answers are journaled.

    Parameters
    ----------
    operator : decides
    journal : journal of the run
    """

    def __init__(self, operator: Operator, journal: Journal) -> None:
        self._operator = operator
        self._journal = journal

    async def decide(self, question: Question) -> Answer | None:
        """Return the answer; None if nobody is there to give one.

        Raises
        ------
        JournalError : question or answer cannot be written
        """
        self._journal.write(
            QuestionRaised(
                code=question.code,
                text=question.text,
                choices=tuple(choice.key for choice in question.choices),
                preview=dict(question.preview),
            )
        )
        answer = await self._operator.decide(question)
        if answer is not None:
            self._journal.write(
                QuestionAnswered(
                    code=question.code, choice=answer.key, who=answer.who, why=answer.why
                )
            )
        return answer
