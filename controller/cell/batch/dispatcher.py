"""The one task that owns the state: takes events, decides by the table, runs effects as tasks.

A stop halts the arm first and cancels the task afterwards. The table ignores what a task reports
that a stop or a fault has overtaken.
"""

import asyncio
import logging
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from drivers.errors import ArmStalledError, DeviceError, SilentLineError

from ..actions import Actions
from ..alarms import Alarm, alarm_of, code_of, device_named
from ..custody import where_it_is
from ..devices.stopping import Stopping
from ..errors import CellError, PartProblemError, PolicyAbortError
from ..journal import Journal, JournalError, rows
from ..machine import CellMachine, Decision, Effect, Event
from ..services.records import BatchRecord
from .watchers import Watcher

log = logging.getLogger(__name__)

WORKER_GONE = "the worker process has died: it was killed, or memory ran out"
End = Literal["complete", "held", "stopped", "aborted", "refused"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a batch ended.

    Attributes
    ----------
    end : state it came to rest in; refused where nothing was allowed to move
    message : what happened, for the operator; empty when all went well
    code : stable short name of what happened, as in the manual
    where : where the part is
    step : in which it happened; empty where no action ended in it
    """

    end: End
    message: str
    code: str
    where: str
    step: str = ""

    @property
    def alarm(self) -> Alarm | None:
        """The alarm of the code; None where all went well."""
        return alarm_of(self.code) if self.code else None


@dataclass(frozen=True, slots=True)
class _Note:
    """An event with its message and code; `of` is the effect that ended in it."""

    event: Event
    of: Effect | None = None
    message: str = ""
    code: str = ""


class Dispatcher:
    """Runs one batch to a state of rest.

    Parameters
    ----------
    actions : one for each effect
    record : has where the part is, for the outcome
    stopping : halts the arm before a task is cancelled
    watchers : report what no action reports
    journal : of the run
    """

    def __init__(
        self,
        actions: Actions,
        record: BatchRecord,
        stopping: Stopping,
        watchers: Sequence[Watcher],
        journal: Journal,
    ) -> None:
        self._actions = actions
        self._record = record
        self._stopping = stopping
        self._watchers = watchers
        self._journal = journal
        self._machine = CellMachine()
        self._inbox: asyncio.Queue[_Note] = asyncio.Queue()
        self._running: tuple[Effect, asyncio.Task[None]] | None = None
        self._message = ""
        self._code = ""
        self._step = ""
        self._has_begun = False
        self._before: _Note | None = None

    @property
    def state(self) -> str:
        """Present state of the cell."""
        return self._machine.state

    def request_stop(self, message: str = "stopped by the operator", code: str = "stop") -> None:
        """Request a stop; no gripper opens. Before `run`, nothing will be started."""
        self._request(_Note(Event.STOP, message=message, code=code))

    def request_abort(self, message: str, code: str) -> None:
        """Report a fault that no effect can report."""
        self._request(_Note(Event.FAULT, message=message, code=code))

    def _request(self, note: _Note) -> None:
        if self._has_begun:
            self._inbox.put_nowait(note)
        elif self._before is None:
            self._before = note

    def _report(self, event: Event, message: str = "", code: str = "") -> None:
        self._inbox.put_nowait(_Note(event, message=message, code=code))

    async def run(self, count: int) -> Outcome:
        """Reset the cell, work through ``count`` parts, come to rest; return how it ended."""
        self._has_begun = True
        if self._before is not None:
            self._message, self._code = self._before.message, self._before.code
            return self._outcome("stopped")
        self._record.parts_left = count
        watchers = [
            asyncio.create_task(watcher.run(self._report), name=type(watcher).__name__)
            for watcher in self._watchers
        ]
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
                        self._inbox.put_nowait(_Note(Event.START))
                    case "complete" | "held" | "aborted" as end:
                        return self._outcome(end)
                    case "stopped" if note.event is Event.STOP_DONE:
                        return self._outcome("stopped")
        finally:
            for watcher in watchers:
                watcher.cancel()
            await asyncio.gather(*watchers, return_exceptions=True)
            # at rest nothing runs; after an error (no journal can be written) a task may still
            # be moving the arm
            await self._end_running(halt=True)

    async def _stop_unrecorded(self, error: JournalError) -> Outcome:
        """Stop every device although no row can be written; return the outcome."""
        await asyncio.gather(self._end_running(halt=True), self._stopping.stop_others())
        where = where_it_is(self._record.part.custody, self._record.part.tray or "")
        message = (
            f"{error}; nothing can be recorded any more, so every device was stopped. "
            "Make room on the disk, or make the file writable, then start again"
        )
        return Outcome("aborted", message, "journal", where)

    def _outcome(self, end: End) -> Outcome:
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
        return Outcome(end, self._message, self._code, where, self._step)

    async def _take(self, note: _Note) -> None:
        decision = self._machine.dispatch(note.event)
        self._journal.write(_event_row(note, decision))
        if decision.answer != "handled":
            log.debug("%s in %s: %s", note.event.value, decision.source, decision.reason)
            return
        if note.message:
            self._message, self._code = note.message, note.code
            self._step = "" if note.of is None else note.of.value
        state = decision.target.removeprefix("execute_")
        self._record.show_state(state, is_at_work=state != decision.target)
        if self._running is not None and self._running[0] is not note.of:
            stops = {Effect.STOP_MOTION, Effect.ABORT_MOTION} & set(decision.effects)
            await asyncio.gather(
                self._end_running(halt=True), *([self._stopping.stop_others()] if stops else [])
            )
        for effect in decision.effects:
            task = asyncio.create_task(self._act(effect), name=f"effect {effect.value}")
            self._running = (effect, task)

    async def _end_running(self, *, halt: bool) -> None:
        """End the running task; halt the arm first, since cancelling a task stops no motor."""
        if self._running is None:
            return
        _, task = self._running
        self._running = None
        if task.done():
            return
        if halt:
            # the effect of the new state stops every device and journals it; this only keeps the
            # arm from moving on while the task unwinds
            await self._stopping.halt_arm()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    async def _act(self, effect: Effect) -> None:
        note = await self._outcome_of(effect)
        if self._running is None or self._running[1] is not asyncio.current_task():
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
            return _Note(Event.FAULT, effect, f"in step {effect.value}: {error}", code_of(error))
        except (DeviceError, CellError, JournalError, OSError) as error:
            return _Note(Event.FAULT, effect, str(error), code_of(error))
        except BrokenExecutor:
            return _Note(Event.FAULT, effect, WORKER_GONE, "worker_gone")
        except ExceptionGroup as group:
            first = group.exceptions[0]
            step = f"in step {effect.value}: " if isinstance(first, SilentLineError) else ""
            return _Note(Event.FAULT, effect, f"{step}{first}", code_of(first))
        except Exception as error:
            # a bug stops the cell like any fault, and is logged with its traceback
            log.exception("effect %s failed", effect.value)
            return _Note(
                Event.FAULT, effect, f"internal error in {effect.value}: {error!r}", "internal"
            )


def _event_row(note: _Note, decision: Decision) -> rows.CellEvent:
    said = {"message": note.message, "code": note.code} if note.message else {}
    alarm = _alarm(note.code, note.message, "" if note.of is None else note.of.value)
    why = {"reason": decision.reason} if decision.reason else {}
    return rows.CellEvent(
        name=note.event.value,
        answer=decision.answer,
        source=decision.source,
        target=decision.target,
        **said,
        **why,
        **alarm,
    )


def _alarm(code: str, message: str, step: str) -> dict[str, rows.AlarmFields]:
    """Return the field `alarm` of a row; nothing where nothing happened."""
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
    """Return what a stalled axis means for the operator."""
    return f"the arm met something it should not have: {error}; look before you clear it"
