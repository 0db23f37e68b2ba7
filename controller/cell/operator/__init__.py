"""Decisions of people: questions with their choices, answers with their giver and reason.

`Operator` is anybody who can decide; `Nobody` is a cell that runs unattended. Every answer is a
decision in the journal. `Desk` keeps the one open question and takes the first answer, by whichever
channel it comes; `questions.py` has the questions about parts, `latch.py` the faults that a person
has to acknowledge before the next start.
"""

from .desk import Desk, OpenQuestion
from .journaled import Journaled
from .latch import LATCHING, Latch, acknowledge, fold_latch, require_acknowledged
from .question import NOBODY, Answer, Choice, Nobody, Operator, Question

__all__ = [
    "LATCHING",
    "NOBODY",
    "Answer",
    "Choice",
    "Desk",
    "Journaled",
    "Latch",
    "Nobody",
    "OpenQuestion",
    "Operator",
    "Question",
    "acknowledge",
    "fold_latch",
    "require_acknowledged",
]
