"""The one task that owns the state: takes events, decides by the table, runs effects as tasks.

A stop withdraws the permit to move and halts the arm before anything is written or shown, and
cancels the task afterwards. The table ignores reports of a task that a stop or a fault has
overtaken. A pause leaves the task alive, waiting at the gate; the effects that begin and end the
pause run beside it.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Literal

from drivers.errors import ArmStalledError, DeviceError, SilentLineError
from messages import key, say

from ..actions import Actions
from ..alarms import Alarm, alarm_of, code_of, device_named
from ..custody import where_it_is
from ..devices.stopping import Stopping
from ..errors import CellError, InterlockError, NotProvenError, PartProblemError, PolicyAbortError
from ..journal import Journal, JournalError, rows
from ..machine import (
    PAUSE_EFFECTS,
    PAUSE_EVENTS,
    RESETTING,
    WORK,
    CellMachine,
    Effect,
    Event,
    MachineDecision,
    Mode,
    PauseKind,
    mode_of,
    work_of,
)
from ..services import Gate, Interlocks, Standstill
from ..services.records import BatchRecord
from .status import CellStatus
from .watching import BatchWatcher

log = logging.getLogger(__name__)

BUTTON = "the acknowledge button"  # name of the acknowledging person if the button was pressed
WORKER_GONE = "the worker process has died: it was killed, or memory ran out"
End = Literal["complete", "held", "stopped", "aborted", "refused"]


@dataclass(frozen=True, slots=True)
class BatchEnd:
    """The end of a batch.

    Attributes
    ----------
    end : state it came to rest in; refused where nothing was allowed to move
    message : message for the operator; empty when all went well
    code : stable short name of what happened, as in the manual
    where : custody of the part
    step : step in which it happened; empty if no action ended in it
    """

    end: End
    message: str
    code: str
    where: str
    step: str = ""

    @property
    def alarm(self) -> Alarm | None:
        """The alarm of the code; None if all went well."""
        return alarm_of(self.code) if self.code else None


@dataclass(frozen=True, slots=True)
class _Note:
    """An event with its message and code.

    Attributes
    ----------
    of : the effect that ended in it
    who, why : the person who sent it, and the reason given
    answer : future of the machine's decision
    lost : reason why nothing can be recorded any more
    """

    event: Event
    of: Effect | None = None
    message: str = ""
    code: str = ""
    who: str = ""
    why: str = ""
    answer: asyncio.Future[MachineDecision] | None = None
    lost: JournalError | None = None


_KIND_OF: Final = {event: kind for kind, event in PAUSE_EVENTS.items()} | {
    Event.STEP: PauseKind.AFTER_STEP
}
_Running = tuple[Effect, asyncio.Task[None]]


class Dispatcher:
    """Runs one batch to a state of rest.

    Parameters
    ----------
    actions : one for each effect
    record : record with the part's custody, for the outcome
    stopping : halts the arm before a task is cancelled
    watchers : report what no action reports
    journal : journal of the run
    gate : opened and closed, and given its permit, as the machine decides
    interlocks : say whether a door is open
    standstill : knows what moves first when a pause ends
    first : function that returns the first event of the ready cell
    on_alarm : called with each event that raises an alarm; must return at once
    signals : function that returns the inputs of the I/O block that are OK, None if unknown; for
        the status
    """

    def __init__(
        self,
        actions: Actions,
        record: BatchRecord,
        stopping: Stopping,
        watchers: Sequence[BatchWatcher],
        journal: Journal,
        gate: Gate,
        interlocks: Interlocks,
        standstill: Standstill,
        first: Callable[[], Event] = lambda: Event.START,
        on_alarm: Callable[[rows.CellEvent], None] = lambda _: None,
        signals: Callable[[], Mapping[str, bool | None]] = dict,
    ) -> None:
        self._on_alarm = on_alarm
        self._first = first
        self._signals = signals
        self._actions = actions
        self._record = record
        self._stopping = stopping
        self._watchers = watchers
        self._journal = journal
        self._gate = gate
        self._gate.guard = self._report_open
        self._interlocks = interlocks
        self._standstill = standstill
        # what held the run, until a person acknowledges it
        self._held_by: _Note | None = None
        self._machine = CellMachine()
        self._inbox: asyncio.Queue[_Note] = asyncio.Queue()
        # the work at hand, and beside it what begins or ends its pause
        self._work: _Running | None = None
        self._pause: _Running | None = None
        self._tasks: set[asyncio.Task[None]] = set()  # all of them, also those overtaken
        self._others: asyncio.Future[None] | None = None  # their stop, once it has begun
        self._message = ""
        self._code = ""
        self._step = ""
        self._has_begun = False
        self._has_ended = False
        self._before: _Note | None = None
        self._on_early_end: Callable[[], None] = lambda: None

    @property
    def state(self) -> str:
        """Present state of the cell."""
        return self._machine.state

    async def status(self) -> CellStatus:
        """Return the cell's status.

        Raises
        ------
        DeviceError : the arm of a paused cell does not report where it stands
        """
        state, progress, part = self._machine.state, self._record.progress, self._record.part
        is_paused = mode_of(state) is Mode.SUSPENDED
        can_pause = mode_of(state) in (Mode.EXECUTE, Mode.SUSPENDING) and state != RESETTING
        alarm = alarm_of(self._code) if self._code else None
        return CellStatus(
            at_s=self._gate.now_s,
            state=state,
            label=progress.label,
            step=progress.step,
            step_count=progress.step_count,
            custody=self._record.part.custody,
            remaining_s=progress.remaining_s,
            message=self._message,
            alarm=""
            if alarm is None
            else say("{number} {words}", number=alarm.number, words=alarm.words),
            point=self._gate.point,
            wanted=self._gate.wanted,
            pause_s={kind: self._gate.seconds_to(kind) for kind in PauseKind if can_pause},
            first=await self._standstill.next_motion() if is_paused else None,
            barred=self._why_barred(Event.RESUME) if is_paused else "",
            signals=self._signals(),
            recipe="" if part.product is None else part.product.recipe.name,
            serial=part.serial,
            done=self._record.done,
        )

    def request_stop(
        self, message: str = key("stopped by the operator"), code: str = "stop"
    ) -> None:
        """Request a stop; no gripper opens. Before `run`, nothing will be started."""
        self._request(_Note(Event.STOP, message=message, code=code))

    def request_abort(self, message: str, code: str) -> None:
        """Report a fault that no effect can report."""
        self._request(_Note(Event.FAULT, message=message, code=code))

    async def command(
        self, event: Event, who: str, why: str = "", message: str = "", code: str = ""
    ) -> MachineDecision:
        """Have a person's command taken in its turn; return the machine's decision.

        Parameters
        ----------
        event : one of `COMMANDS`
        who, why : the person, and the reason given
        message, code : for the operator, where the command ends the run
        """
        if not self._has_begun and event in (Event.STOP, Event.FAULT):
            self._request(_Note(event, message=message, code=code, who=who, why=why))
            return MachineDecision("handled", self.state, self.state)
        if self._has_ended or not self._has_begun:
            when = "has come to rest" if self._has_ended else "is still connecting its devices"
            return MachineDecision("refused", self.state, self.state, reason=f"the run {when}")
        answer: asyncio.Future[MachineDecision] = asyncio.get_running_loop().create_future()
        self._inbox.put_nowait(
            _Note(event, message=message, code=code, who=who, why=why, answer=answer)
        )
        return await answer

    def _request(self, note: _Note) -> None:
        if self._has_begun:
            self._inbox.put_nowait(note)
        elif self._before is None:
            self._before = note
            self._on_early_end()

    def on_early_end(self, call: Callable[[], None]) -> None:
        """Have a function called if the run ends before anything has moved."""
        self._on_early_end = call

    def _report(self, event: Event, message: str = "", code: str = "") -> None:
        self._inbox.put_nowait(_Note(event, message=message, code=code))

    async def run(self) -> BatchEnd:
        """Reset the cell, work through the parts ordered, come to rest; return the outcome."""
        self._has_begun = True
        if self._before is not None:
            self._message, self._code = self._before.message, self._before.code
            return self._outcome("stopped")
        watchers = [
            asyncio.create_task(watcher.run(self._report), name=type(watcher).__name__)
            for watcher in self._watchers
        ]
        self._journal.on_failure = self._hear_of_the_journal(asyncio.get_running_loop())
        try:
            self._inbox.put_nowait(_Note(Event.RESET))
            while True:
                note = await self._inbox.get()
                try:
                    await self._take(note)
                except JournalError as error:
                    return await self._stop_unrecorded(error)
                match self._machine.state:
                    case "idle":
                        self._inbox.put_nowait(_Note(self._first()))
                    case "complete" | "aborted" as end:
                        return self._outcome(end)
                    case "held" if note.event is Event.UNATTENDED:
                        return self._outcome("held")
                    case "stopped" if note.event is Event.STOP_DONE:
                        return self._outcome("stopped")
        finally:
            self._has_ended = True
            self._journal.on_failure = None
            self._refuse_the_rest()
            for watcher in watchers:
                watcher.cancel()
            await asyncio.gather(*watchers, return_exceptions=True)
            # at rest nothing runs; after an error (no journal can be written), or given up while
            # something was being ended, a task may still be moving the arm
            await self._end(self._pause)
            await self._end(self._work)
            await self._end_the_rest()

    def _hear_of_the_journal(
        self, loop: asyncio.AbstractEventLoop
    ) -> Callable[[JournalError], None]:
        """Return the callback by which the writer thread reports a row that it failed to write."""

        def hear(error: JournalError) -> None:
            with suppress(RuntimeError):  # the loop has ended meanwhile
                loop.call_soon_threadsafe(
                    self._inbox.put_nowait, _Note(Event.FAULT, lost=error, code="journal")
                )

        return hear

    async def _end_the_rest(self) -> None:
        """End the tasks that were overtaken and are not at their end."""
        left = tuple(task for task in self._tasks if not task.done())
        if not left:
            return
        await self._stopping.halt_arm()
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    def _refuse_the_rest(self) -> None:
        """Answer commands that came too late."""
        while not self._inbox.empty():
            answer = self._inbox.get_nowait().answer
            if answer is not None and not answer.done():
                reason = key("the run has come to rest")
                answer.set_result(MachineDecision("refused", self.state, self.state, reason=reason))

    async def _stop_unrecorded(self, error: JournalError) -> BatchEnd:
        """Stop every device although no row can be written; return the outcome."""
        with suppress(JournalError):
            self._gate.permits.withdraw("journal")
        await asyncio.gather(
            self._end(self._work),
            self._end(self._pause),
            self._others or self._stopping.stop_others(),
        )
        where = where_it_is(self._record.part.custody, self._record.part.tray or "")
        message = say(
            "{error}; nothing can be recorded any more, so every device was "
            "stopped. See that the file is in its place, can be written and "
            "has room on its disk, then start again",
            error=error,
        )
        return BatchEnd("aborted", message, "journal", where)

    def _outcome(self, end: End) -> BatchEnd:
        custody = self._record.part.custody
        where = where_it_is(custody, self._record.part.tray or "")
        at_rest = rows.AtRest(
            state=end,
            message=self._message,
            code=self._code,
            custody=custody.key.upper(),
            **_alarm(self._code, self._message, self._step),
        )
        with suppress(JournalError):  # at rest already: the next start finds the run unfinished
            self._journal.write(at_rest)
        return BatchEnd(end, self._message, self._code, where, self._step)

    async def _take(self, note: _Note) -> None:
        if note.lost is not None:
            raise note.lost
        decision = self._refusal(note.event) or self._machine.dispatch(note.event)
        step = self._step_of(note)
        row = _event_row(note, decision, step)
        ends: list[asyncio.Future[None]] = []
        with self._journal.held_back():
            self._journal.write(row)
            if decision.answer == "handled":
                if decision.permits:
                    self._gate.permits.issue(note.event.value)
                elif decision.forbids:
                    self._gate.permits.withdraw(note.event.value)
                if not _lets_through(decision):
                    self._set_gate(note.event, decision)
                ends = await self._halt_overtaken(note, decision)
        if note.event is Event.GUARD_OPENED and mode_of(decision.source) is not None:
            has_looked = work_of(decision.source) != RESETTING
            self._standstill.note_open(has_looked=has_looked)
        if note.answer is not None and not note.answer.done():
            note.answer.set_result(decision)
        if decision.answer != "handled":
            log.debug("%s in %s: %s", note.event.value, decision.source, decision.reason)
            return
        if note.event is Event.ACKNOWLEDGE:
            self._take_acknowledgement(note)
        if decision.permits:  # what there was is over
            self._message = self._code = self._step = ""
        if note.message:
            self._message, self._code = note.message, note.code
            self._step = step
            self._on_alarm(row)
        if note.event is Event.GUARD_OPENED and mode_of(decision.target) is not None:
            self._held_by = note
        if decision.target == "holding":
            self._record.problem = (note.code, note.message)
        state = decision.target.removeprefix("execute_")
        work = work_of(decision.target)
        self._record.show_state(
            state,
            is_at_work=work is not None,
            is_same_work=work is not None and work == work_of(decision.source),
        )
        await asyncio.gather(*ends)
        if _lets_through(decision):
            # not before: what was overtaken waits at the gate until it is ended
            self._set_gate(note.event, decision)
            if decision.target == RESETTING and self._work is not None and self._work[1].done():
                self._report(Event.RESET_DONE)  # homing has ended in the pause
        for effect in decision.effects:
            task = asyncio.create_task(self._act(effect), name=f"effect {effect.value}")
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
            if effect in PAUSE_EFFECTS:
                self._pause = (effect, task)
            else:
                self._work = (effect, task)

    def _report_open(self) -> bool:
        """Return whether a door is open; if so, hold the run."""
        violation = self._interlocks.holding()
        if violation is None:
            return False
        self._report(Event.GUARD_OPENED, violation.message, violation.code)
        return True

    def _refusal(self, event: Event) -> MachineDecision | None:
        """Return the decision that ignores or refuses an event outside the state table, or None."""
        state = self._machine.state
        mode = mode_of(state)
        if event is Event.GUARD_OPENED and mode is Mode.SUSPENDING and self._held_by is not None:
            return MachineDecision(
                "ignored", state, state, reason=key("this holds the run already")
            )
        if mode is not Mode.SUSPENDED:
            return None
        reason = self._why_barred(event)
        return MachineDecision("refused", state, state, reason=reason) if reason else None

    def _why_barred(self, event: Event) -> str:
        """Return the condition that a paused cell needs before a command; empty for none."""
        if event not in (Event.RESUME, Event.STEP, Event.ACKNOWLEDGE):
            return ""
        violation = self._interlocks.holding()
        if violation is not None:
            return violation.message
        if event is Event.ACKNOWLEDGE:
            return (
                ""
                if self._held_by is not None
                else key("nothing is waiting for an acknowledgement")
            )
        if self._held_by is not None:
            return say(
                "the run was held ({message}): look at the cell and acknowledge "
                'that, `cellctl ack --why "..."`, then resume',
                message=self._held_by.message,
            )
        if event is Event.STEP and self._standstill.looks_again:
            return key("the door was open, so the cell looks for the part first: resume")
        return ""

    def _take_acknowledgement(self, note: _Note) -> None:
        held_by, self._held_by = self._held_by, None
        assert held_by is not None, "nothing else is acknowledged"
        self._journal.write(
            rows.Acknowledged(
                run=self._journal.run, code=held_by.code, who=note.who or BUTTON, why=note.why
            )
        )

    def _step_of(self, note: _Note) -> str:
        """Return the action that a note comes from or was reported during; empty if none."""
        effect = note.of or (None if self._work is None else self._work[0])
        return "" if effect is None else effect.value

    def _set_gate(self, event: Event, decision: MachineDecision) -> None:
        """Set the gate for the new state: hold a pause, or let motion through."""
        match mode_of(decision.target):
            case Mode.SUSPENDED:
                self._gate.close()
            case Mode.UNSUSPENDING:
                self._gate.prepare(is_single_step=event is Event.STEP)
            case Mode.SUSPENDING if event is Event.GUARD_OPENED:
                self._gate.halt()
            case Mode.SUSPENDING if event is Event.STEP_BEGUN:
                self._gate.open_for_step()
            case Mode.SUSPENDING if event in _KIND_OF:
                self._gate.want(_KIND_OF[event])
            case _ if _lets_through(decision):
                self._gate.open()

    async def _halt_overtaken(
        self, note: _Note, decision: MachineDecision
    ) -> list[asyncio.Future[None]]:
        """Halt work that the new state has ended: replaced actions, a pause that is over.

        Returns
        -------
        what is to be awaited then: the ends of the tasks, since cancelling one stops no motor, and
        the stops of the other devices, which have begun
        """
        overtaken = []
        source, target = decision.source, decision.target
        if self._pause is not None and mode_of(source) is not mode_of(target):
            overtaken += [self._pause] if self._pause[0] is not note.of else []
            self._pause = None
        is_kept = work_of(source) is not None and work_of(source) == work_of(target)
        if self._work is not None and not is_kept and source != target:
            overtaken += [self._work] if self._work[0] is not note.of else []
            self._work = None
        ends = []
        if overtaken and {Effect.STOP_MOTION, Effect.ABORT_MOTION} & set(decision.effects):
            self._others = asyncio.ensure_future(self._stopping.stop_others())
            ends.append(self._others)
        await self._halt(*overtaken)
        return [*ends, *(asyncio.ensure_future(_cancelled(one)) for one in overtaken)]

    async def _halt(self, *running: _Running) -> None:
        """Halt the arm, unless the tasks only wait for a pause; nobody waits for a confirmation.

        The effect of the new state stops every device and journals it; this only keeps the arm from
        moving on while the tasks unwind.
        """
        if any(effect is not Effect.SUSPEND and not task.done() for effect, task in running):
            await self._stopping.halt_arm()

    async def _end(self, running: _Running | None) -> None:
        """End a task; halt the arm first."""
        if running is not None:
            await self._halt(running)
            await _cancelled(running)

    async def _act(self, effect: Effect) -> None:
        note = await self._outcome_of(effect)
        running = self._pause if effect in PAUSE_EFFECTS else self._work
        if running is None or running[1] is not asyncio.current_task():
            # overtaken: the stop itself may be what made it fail
            self._journal.write(rows.Overtaken(effect=effect.value, message=note.message))
            return
        self._inbox.put_nowait(note)

    async def _outcome_of(self, effect: Effect) -> _Note:
        try:
            return _Note(await self._actions.perform(effect), effect)
        except PartProblemError as problem:
            return _Note(Event.PART_PROBLEM, effect, str(problem), problem.code)
        except ArmStalledError as error:
            return _Note(Event.FAULT, effect, _explain_stall(error), "stall")
        except PolicyAbortError as error:
            return _Note(Event.FAULT, effect, str(error), error.code)
        except SilentLineError as error:
            return _Note(
                Event.FAULT,
                effect,
                say("in step {value}: {error}", value=effect.value, error=error),
                code_of(error),
            )
        except NotProvenError as error:
            return _Note(Event.NOT_PROVEN, effect, str(error), code_of(error))
        except InterlockError as error:
            # work that waits for a door is held at the gate, and goes on with it
            is_held = error.holds and effect not in WORK.values()
            event = Event.GUARD_OPENED if is_held else Event.FAULT
            return _Note(event, effect, str(error), error.code)
        except (DeviceError, CellError, JournalError, OSError) as error:
            return _Note(Event.FAULT, effect, str(error), code_of(error))
        except BrokenExecutor:
            return _Note(Event.FAULT, effect, WORKER_GONE, "worker_gone")
        except ExceptionGroup as group:
            first = group.exceptions[0]
            words = str(first)
            if isinstance(first, SilentLineError):
                words = say("in step {step}: {words}", step=effect.value, words=words)
            return _Note(Event.FAULT, effect, words, code_of(first))
        except Exception as error:
            # a bug stops the cell like any fault, and is logged with its traceback
            log.exception("effect %s failed", effect.value)
            return _Note(
                Event.FAULT,
                effect,
                say("internal error in {value}: {error}", value=effect.value, error=repr(error)),
                "internal",
            )


async def _cancelled(running: _Running) -> None:
    """Cancel a task and wait until it has ended."""
    running[1].cancel()
    await asyncio.gather(running[1], return_exceptions=True)


def _lets_through(decision: MachineDecision) -> bool:
    """Return whether the gate opens in the new state."""
    mode = mode_of(decision.target)
    return mode is Mode.EXECUTE or (mode is None and decision.permits)


def _event_row(note: _Note, decision: MachineDecision, step: str) -> rows.CellEvent:
    said = {"message": note.message, "code": note.code} if note.message else {}
    alarm = _alarm(note.code, note.message, step)
    person = {"who": note.who, "why": note.why} if note.who else {}
    why = {"reason": decision.reason} if decision.reason else {}
    return rows.CellEvent(
        name=note.event.value,
        answer=decision.answer,
        source=decision.source,
        target=decision.target,
        **said,
        **why,
        **alarm,
        **person,
    )


def _alarm(code: str, message: str, step: str) -> dict[str, rows.AlarmFields]:
    """Return the field `alarm` of a row; empty without an alarm."""
    if not code:
        return {}
    alarm = alarm_of(code)
    fields = rows.AlarmFields(
        number=alarm.number,
        code=alarm.code,
        device=device_named(alarm, message),
        step=step,
        unknown=alarm.unknown,
        action=alarm.action,
    )
    return {"alarm": fields}


def _explain_stall(error: ArmStalledError) -> str:
    """Return the message to the operator about a stalled axis."""
    return say(
        "the arm met something it should not have: {error}; look before you clear it", error=error
    )
