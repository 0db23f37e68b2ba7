"""A person's approval of each motion after a look at it: `cellctl run --step`."""

import asyncio
from typing import Final

from controller.cell.errors import NoPermitError
from controller.cell.journal.rows import FirstMotion
from controller.cell.operator import Choice, Operator, Question
from messages import key, say

GO: Final = "go"
NEXT_MOTION: Final = "next_motion"


class Approval:
    """Puts each motion to the operator, one after another.

    Parameters
    ----------
    operator : person who decides; question and answer are in the journal
    """

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._one_question = asyncio.Lock()

    async def __call__(self, motion: FirstMotion) -> None:
        """Return once a person has approved a motion.

        Raises
        ------
        NoPermitError : nobody is there to decide
        """
        question = Question(
            NEXT_MOTION,
            say("next: {words}", words=motion.words),
            (Choice(GO, key("permit this motion")),),
        )
        async with self._one_question:
            answer = await self._operator.decide(question)
        if answer is None:
            raise NoPermitError(key("nothing may move: nobody is there to permit each motion"))
