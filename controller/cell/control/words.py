"""The bodies of the control socket's requests and replies, one model each. No I/O.

A reply has keys and values of its sentences beside them (`messages.form`).
"""

import json
from dataclasses import asdict
from typing import Any, Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import from_json

from messages.fields import Sentence
from messages.form import SAID, from_said, with_said

from ..lock import Holder

# largest length in characters
MAX_WHO: Final = 200
MAX_WHY: Final = 1000
MAX_KEY: Final = 80

Short = Field(default="", max_length=MAX_WHO)
Reason = Field(default="", max_length=MAX_WHY)


SomeReply = TypeVar("SomeReply", bound=BaseModel)


def facts(reply: BaseModel) -> dict[str, Any]:
    """Return a reply as JSON values; its sentences keep their keys."""
    return reply.model_dump()


def reply_bytes(reply: BaseModel) -> bytes:
    """Return a reply as it goes over the socket."""
    return json.dumps(with_said(facts(reply)), ensure_ascii=False).encode()


def reply_of(model: type[SomeReply], body: bytes) -> SomeReply:
    """Return a reply of its bytes.

    Raises
    ------
    ValueError : it is not of this model
    """
    return model.model_validate(from_said(from_json(body)))


class _Body(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _add_said(schema: dict[str, Any]) -> None:
    schema["properties"][SAID] = {
        "type": "object",
        "default": {},
        "description": "key and values of each sentence, by its English",
    }


class _Reply(_Body):
    model_config = ConfigDict(json_schema_extra=_add_said)


class Order(_Body):
    """An order; `who` adds to the user's name, which the kernel gives."""

    who: str = Short
    why: str = Reason


class PauseOrder(Order):
    """The time of a pause: after this step, at the next safe point, now."""

    kind: Literal["step", "safe", "now"] = "safe"


class ResumeOrder(Order):
    """The first motion, as shown; the order is refused if another would come first by now."""

    first: str | None = Field(default=None, max_length=1000)


class AckOrder(Order):
    """An acknowledgement states why the cell may go on."""

    why: str = Field(min_length=1, max_length=MAX_WHY)


class AnswerOrder(Order):
    """An answer; `number` is that of the question that was seen, by default the open one."""

    key: str = Field(min_length=1, max_length=MAX_KEY)
    number: int | None = Field(default=None, ge=1)


class DecisionReply(_Reply):
    """The cell's decision on an order; `reason` is why it was ignored or refused."""

    decision: Literal["handled", "ignored", "refused"]
    state: str
    reason: Sentence = ""


class MotionReply(_Body):
    """The first motion after a pause: the TCP's travel, and its duration in cell seconds, roughly.

    `waypoints` are the joints of the arm, mm or rad, where this motion begins and ends; empty where
    no joint but the jaws moves, and where nobody knows its path, as in homing.
    """

    words: Sentence
    tcp_mm: float
    turn_deg: float
    seconds: float
    waypoints: tuple[tuple[float, ...], ...] = ()


class ChoiceReply(_Body):
    """A possible answer; `first` is the first motion after it, empty if nothing moves."""

    key: str
    words: Sentence
    first: Sentence = ""


class QuestionReply(_Body):
    """A question that waits for its answer.

    `entry` is what may be given in place of a choice, such as a serial number; empty for nothing.
    """

    number: int
    code: str
    text: Sentence
    choices: tuple[ChoiceReply, ...]
    entry: str = ""


class HolderReply(_Body):
    """The holder of the cell's lock, and the path of the control socket that it serves."""

    run: str
    user: str
    host: str
    pid: int
    since: str
    control: str = ""

    @classmethod
    def of(cls, holder: Holder) -> "HolderReply":
        """Return a lock's holder as a reply."""
        return cls.model_validate(asdict(holder))


class StatusReply(_Reply):
    """The cell's status; durations are cell seconds, null if unknown.

    `at_s` is the cell's clock; only its differences are meaningful. `signals` are the inputs of the
    I/O block by name: true if OK, null if unknown. `barred` is the condition for a resume, such as
    a closed door; empty if there is none. `recipe` and `serial` belong to the current part, empty
    before it was recognised or where it has none; `done` has the numbers of finished and of ordered
    parts of each recipe.
    """

    run: str
    at_s: float | None
    state: str
    label: Sentence
    step: int
    step_count: int
    custody: str
    seconds_left: float | None
    message: Sentence
    safe_point: Sentence | None
    pausing: Literal["step", "safe", "now"] | None
    pause_seconds: dict[Literal["step", "safe", "now"], float | None]
    first_motion: MotionReply | None
    question: QuestionReply | None
    alarms: tuple[Sentence, ...]
    holder: HolderReply
    barred: Sentence = ""
    signals: dict[str, bool | None] = {}
    recipe: str = ""
    serial: str = ""
    done: dict[str, tuple[int, int]] = {}


class ErrorReply(_Reply):
    """Why a request was not taken."""

    error: Sentence
