"""The endpoints: each request as an order to the dispatcher, and the reply to it. No wire.

Each endpoint is data (`ENDPOINTS`); the server, the OpenAPI description and its test read the same.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Final

from pydantic import BaseModel

from controller.cell.batch import CellStatus, Dispatcher
from controller.cell.custody import Custody
from controller.cell.journal.rows import FirstMotion
from controller.cell.lock import Holder
from controller.cell.machine import PAUSE_EVENTS, Event, MachineDecision, PauseKind
from controller.cell.operator import Answer, Desk
from messages import say

from .. import words
from ..peer import Peer


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer: its HTTP status and its body."""

    status: int
    body: BaseModel


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One request that a running cell answers.

    Attributes
    ----------
    method, path : method and path of the request
    summary : one-line summary
    takes : model of the request's body, None if it has none
    returns : model of the answer's body where the request was taken
    call : does it
    is_stop : whether it stops the cell, also by the supervisor while the event loop is late
    """

    method: str
    path: str
    summary: str
    takes: type[BaseModel] | None
    returns: type[BaseModel]
    call: Callable[["Control", Peer, BaseModel], Awaitable[Reply]]
    is_stop: bool = False


class Control:
    """A running cell, as its control socket shows it.

    Parameters
    ----------
    run : its name
    holder : holder of the cell's lock
    desk : desk with the open question
    """

    def __init__(self, run: str, holder: Holder, desk: Desk) -> None:
        self._run = run
        self._holder = holder
        self._desk = desk
        self._dispatcher: Dispatcher | None = None
        self._stop: Callable[[str, str], None] | None = None

    def attach_stop(self, stop: Callable[[str, str], None]) -> None:
        """Let stops through to work that has no dispatcher: a dry run, a step of commissioning.

        Parameters
        ----------
        stop : callback that ends the work with a message and a code
        """
        self._stop = stop

    def attach(self, dispatcher: Dispatcher) -> None:
        """Let orders through to a dispatcher; before, the run is only starting."""
        self._dispatcher = dispatcher

    async def status(self, peer: Peer, body: BaseModel) -> Reply:
        """Return the cell's status."""
        found = await self._status()
        return Reply(200, self._starting() if found is None else self._standing(found))

    def _starting(self) -> words.StatusReply:
        """Return the status of a run that has no device yet."""
        return words.StatusReply(
            run=self._run,
            at_s=None,
            state="starting",
            label="",
            step=0,
            step_count=0,
            custody=Custody.NONE.value,
            seconds_left=None,
            message="",
            safe_point=None,
            pausing=None,
            pause_seconds={},
            first_motion=None,
            question=_question(self._desk),
            alarms=(),
            holder=words.HolderReply.of(self._holder),
        )

    def _standing(self, found: CellStatus) -> words.StatusReply:
        return words.StatusReply(
            run=self._run,
            at_s=round(found.at_s, 3),
            state=found.state,
            label=found.label,
            step=found.step,
            step_count=found.step_count,
            custody=found.custody.value,
            seconds_left=found.remaining_s,
            message=found.message,
            safe_point=None if found.point is None else found.point.value,
            pausing=None if found.wanted is None else found.wanted.value,
            pause_seconds={
                kind.value: None if s is None else round(s, 1) for kind, s in found.pause_s.items()
            },
            first_motion=_motion(found.first),
            question=_question(self._desk),
            alarms=(found.alarm,) if found.alarm else (),
            holder=words.HolderReply.of(self._holder),
            barred=found.barred,
            signals=dict(found.signals),
            recipe=found.recipe,
            serial=found.serial,
            done=dict(found.done),
        )

    async def pause(self, peer: Peer, body: BaseModel) -> Reply:
        """Pause after this step, at the next safe point, or now; return the decision."""
        assert isinstance(body, words.PauseOrder)
        return await self._order(PAUSE_EVENTS[PauseKind(body.kind)], peer, body)

    async def resume(self, peer: Peer, body: BaseModel) -> Reply:
        """Go on, if the first motion is still the one shown; return the decision."""
        assert isinstance(body, words.ResumeOrder)
        if body.first is not None:
            found = await self._status()
            now = "" if found is None or found.first is None else found.first.words
            if now != body.first:
                reason = say(
                    "another motion comes first by now: {now}", now=now or "nothing is known"
                )
                return _refused(self._state, reason)
        return await self._order(Event.RESUME, peer, body)

    async def step(self, peer: Peer, body: BaseModel) -> Reply:
        """Do one step of the plan, then pause; return the decision."""
        assert isinstance(body, words.Order)
        return await self._order(Event.STEP, peer, body)

    async def stop(self, peer: Peer, body: BaseModel) -> Reply:
        """Stop every device on a ramp and end the run; nothing is released; return the decision."""
        assert isinstance(body, words.Order)
        return await self._order(
            Event.STOP,
            peer,
            body,
            say("stopped by {who}{because}", who=_who(peer, body), because=_because(body)),
            code="stop",
        )

    async def abort(self, peer: Peer, body: BaseModel) -> Reply:
        """Stop every device at once and end the run; nothing is released; return the decision."""
        assert isinstance(body, words.Order)
        return await self._order(
            Event.FAULT,
            peer,
            body,
            say("aborted by {who}{because}", who=_who(peer, body), because=_because(body)),
            code="aborted",
        )

    async def ack(self, peer: Peer, body: BaseModel) -> Reply:
        """Acknowledge what bars a start or a resume, such as an open door; return the decision."""
        assert isinstance(body, words.AckOrder)
        open_ = self._desk.open
        if open_ is None or "ack" not in {choice.key for choice in open_.question.choices}:
            return await self._order(Event.ACKNOWLEDGE, peer, body)
        return self._answer(peer, "ack", open_.number, body)

    async def answer(self, peer: Peer, body: BaseModel) -> Reply:
        """Answer the open question; the first answer counts; return the decision."""
        assert isinstance(body, words.AnswerOrder)
        return self._answer(peer, body.key, body.number, body)

    async def recover(self, peer: Peer, body: BaseModel) -> Reply:
        """Answer a question about a part that an earlier run left; return the decision."""
        assert isinstance(body, words.AnswerOrder)
        open_ = self._desk.open
        if open_ is None or open_.question.code != RECOVERY_CODE:
            return _refused(self._state, "no question about a recovery is open")
        return self._answer(peer, body.key, body.number, body)

    @property
    def _state(self) -> str:
        return "starting" if self._dispatcher is None else self._dispatcher.state

    async def _status(self) -> CellStatus | None:
        return None if self._dispatcher is None else await self._dispatcher.status()

    def _answer(self, peer: Peer, key: str, number: int | None, body: words.Order) -> Reply:
        refusal = self._desk.answer(number, Answer(key, _who(peer, body), body.why))
        if refusal:
            return _refused(self._state, refusal)
        return Reply(200, words.DecisionReply(decision="handled", state=self._state))

    async def _order(
        self, event: Event, peer: Peer, body: words.Order, message: str = "", code: str = ""
    ) -> Reply:
        if self._dispatcher is None:
            if self._stop is not None and event in (Event.STOP, Event.FAULT):
                self._stop(message, code)
                return Reply(200, words.DecisionReply(decision="handled", state="stopping"))
            return _refused("starting", "the run is starting: no device is connected yet")
        decision = await self._dispatcher.command(event, _who(peer, body), body.why, message, code)
        return _decided(decision)


# Code of the question whether a start goes on with the part that an earlier run left.
RECOVERY_CODE: Final = "part_left"


def _who(peer: Peer, body: words.Order) -> str:
    return say("{who} ({name})", who=body.who, name=peer.name) if body.who else peer.name


def _because(body: words.Order) -> str:
    return say(": {why}", why=body.why) if body.why else ""


def _motion(first: FirstMotion | None) -> words.MotionReply | None:
    if first is None:
        return None
    return words.MotionReply(
        words=first.words,
        tcp_mm=first.tcp_mm,
        turn_deg=first.turn_deg,
        seconds=first.seconds,
        waypoints=tuple(q for q in (first.origin, first.goal) if q),
    )


def _question(desk: Desk) -> words.QuestionReply | None:
    open_ = desk.open
    if open_ is None:
        return None
    first = dict(open_.question.preview)
    return words.QuestionReply(
        number=open_.number,
        code=open_.question.code,
        text=open_.question.text,
        choices=tuple(
            words.ChoiceReply(key=c.key, words=c.words, first=first.get(c.key, ""))
            for c in open_.question.choices
        ),
        entry=open_.question.entry,
    )


def _decided(decision: MachineDecision) -> Reply:
    reply = words.DecisionReply(
        decision=decision.answer, state=decision.target, reason=decision.reason
    )
    return Reply(409 if decision.answer == "refused" else 200, reply)


def _refused(state: str, reason: str) -> Reply:
    return Reply(409, words.DecisionReply(decision="refused", state=state, reason=reason))


def _listed() -> tuple[Endpoint, ...]:
    decision = words.DecisionReply
    rows: tuple[tuple[str, str, type[BaseModel] | None, type[BaseModel]], ...] = (
        ("GET", "status", None, words.StatusReply),
        ("POST", "pause", words.PauseOrder, decision),
        ("POST", "resume", words.ResumeOrder, decision),
        ("POST", "step", words.Order, decision),
        ("POST", "stop", words.Order, decision),
        ("POST", "abort", words.Order, decision),
        ("POST", "ack", words.AckOrder, decision),
        ("POST", "answer", words.AnswerOrder, decision),
        ("POST", "recover", words.AnswerOrder, decision),
    )
    found = []
    for method, name, takes, returns in rows:
        call = getattr(Control, name)
        summary = str(call.__doc__).strip().removesuffix("; return the decision.")
        is_stop = name in ("stop", "abort")
        found.append(Endpoint(method, f"/{name}", summary, takes, returns, call, is_stop))
    return tuple(found)


ENDPOINTS: Final = _listed()
# First bytes of the requests that stop the cell.
STOPS: Final = tuple(f"{one.method} {one.path} ".encode() for one in ENDPOINTS if one.is_stop)
BY_PATH: Final[Mapping[str, Endpoint]] = {endpoint.path: endpoint for endpoint in ENDPOINTS}
