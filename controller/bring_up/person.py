"""The person who answers a step's questions and helps by hand.

A real cell has a person. An emulated cell that is commissioned unattended has a helper in the
person's place, whose hands are the emulator's control port: it lays a board where the person would,
and reads nothing that a person could not see.
"""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from controller.cell.errors import CellError
from controller.cell.operator import Answer, Choice, Operator, Question
from messages import say

from .errors import DeclinedError, NobodyThereError
from .evidence import StepEvidence
from .procedure import GivenAnswer

GO_ON: Final = "yes"
STOP: Final = "stop"
HELPER: Final = "--yes"
PORT_TIMEOUT_WALL_S: Final = 60.0  # a guard against a hang


@dataclass(frozen=True, slots=True)
class Errand:
    """A task for hands in the cell.

    Attributes
    ----------
    code : stable short name
    text : for a person
    orders : equivalent orders to the control port of an emulated cell
    """

    code: str
    text: str
    orders: tuple[Mapping[str, Any], ...] = ()


class Person:
    """The person at the cell.

    Parameters
    ----------
    operator : gives the answers
    evidence : keeps them
    helper : helper with errands in an emulated cell; None if a person does them
    """

    def __init__(
        self, operator: Operator, evidence: StepEvidence, helper: "EmulatedPerson | None" = None
    ) -> None:
        self._operator = operator
        self._evidence = evidence
        self._helper = helper

    async def choose(self, code: str, text: str, choices: tuple[Choice, ...]) -> str:
        """Return the key of the choice that was made.

        Parameters
        ----------
        code : stable short name of the question
        text : question
        choices : the possible answers

        Raises
        ------
        NobodyThereError : nobody is there
        """
        answer = await self._operator.decide(Question(code, text, choices))
        if answer is None:
            raise NobodyThereError(
                say(
                    "a person is required: {text} Start it in a terminal; --yes "
                    "answers on an emulated cell",
                    text=text,
                )
            )
        self._evidence.answers.append(GivenAnswer(text=text, choice=answer.key, who=answer.who))
        return answer.key

    async def confirm(self, code: str, text: str) -> None:
        """Return once a person agrees.

        Raises
        ------
        DeclinedError : they end the step
        NobodyThereError : nobody is there
        """
        choices = (Choice(GO_ON, "it is so: go on"), Choice(STOP, "end this step"))
        if await self.choose(code, text, choices) != GO_ON:
            raise DeclinedError(say("ended by a person: {text}", text=text))

    async def have_done(self, errand: Errand) -> None:
        """Return once an errand is done.

        Raises
        ------
        DeclinedError : a person ends the step
        NobodyThereError : nobody is there
        CellError : the emulated cell refuses it
        """
        if self._helper is not None:
            await self._helper.do(errand)
        await self.confirm(errand.code, errand.text)


class EmulatedPerson:
    """Answers for a person, and lends the hands of one, in an emulated cell.

    Parameters
    ----------
    port : unix socket of the emulator's control port
    """

    def __init__(self, port: Path) -> None:
        self._port = port

    async def decide(self, question: Question) -> Answer:
        """Return the first choice of a question."""
        return Answer(question.choices[0].key, HELPER)

    async def do(self, errand: Errand) -> None:
        """Carry out an errand's orders.

        Raises
        ------
        CellError : the port is gone, or it refuses one
        """
        if not errand.orders:
            return
        try:
            async with asyncio.timeout(PORT_TIMEOUT_WALL_S):
                reader, writer = await asyncio.open_unix_connection(str(self._port))
                try:
                    for order in errand.orders:
                        writer.write(json.dumps(dict(order)).encode() + b"\n")
                        await writer.drain()
                        _require_done(errand, await reader.readline())
                finally:
                    writer.close()
        except (OSError, TimeoutError) as error:
            raise CellError(
                say(
                    "{code}: the emulated cell has no hands: {error}", code=errand.code, error=error
                )
            ) from error


def _require_done(errand: Errand, line: bytes) -> None:
    try:
        reply = json.loads(line)
    except ValueError as error:
        raise CellError(say("{code}: the emulated cell has ended", code=errand.code)) from error
    if not reply.get("ok"):
        raise CellError(
            say(
                "{code}: the emulated cell refuses: {get}", code=errand.code, get=reply.get("error")
            )
        )
