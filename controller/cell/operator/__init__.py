"""Decisions of people: questions with their choices, answers with who gave them and why.

`Operator` is whoever can decide; `Nobody` is a cell that runs unattended. Every answer is a
decision in the journal.
"""

from .question import NOBODY, Answer, Choice, Nobody, Operator, Question

__all__ = ["NOBODY", "Answer", "Choice", "Nobody", "Operator", "Question"]
