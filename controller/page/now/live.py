"""One poller for all browsers: reads journal and control socket, and passes on the changes.

The journal's tail is read every 100 ms, and only if its file has changed. The control socket is
polled right after a new row, and otherwise twice a second: while a cell is paused, its status reads
the arm's position. Nothing here writes, and nothing waits for it: a killed page goes unnoticed.

*Now* is sent in pieces, each only when its text has changed; the pieces that a browser has not read
yet are one message, so that it never shows one piece of a change without the others.
"""

import asyncio
import json
import logging
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from controller.cell.alarms import BY_NUMBER
from controller.cell.control import (
    ControlError,
    NoRunError,
    NotServedError,
    RunningCell,
    StatusReply,
    facts,
    left_in_grippers,
)
from controller.cell.custody import Held
from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    journal_mark,
    newest_run,
    read_rows_after,
)
from controller.cell.lock import Holder
from messages import say
from messages.words import LANGUAGES, words_in

from .fold import JournaledArm, RunFold
from .left import fold_of, unfinished
from .scene import CellScene, Waypoints

log = logging.getLogger(__name__)

POLL_WALL_S: Final = 0.1
STATUS_WALL_S: Final = 0.5
# Period at which a browser gets the age of its data; three beats fit into `FRESH_WALL_S`.
BEAT_WALL_S: Final = 1.0
# Time for which a status is shown while the cell is polled again; an older one no longer describes
# the present. `LOST_MS` of stream.js limits the page's own stream alike.
FRESH_WALL_S: Final = 3.0
# States in which a run has not yet decided on a part that an earlier one left in a gripper.
UNDECIDED: Final = ("starting", "stopped")
WATCHER_MAX_COUNT: Final = 40
WATCHER_OF_ONE_MAX_COUNT: Final = 10  # limit, so that one account cannot take the room of all
# limit, so that one address with several accounts cannot either
WATCHER_OF_ADDRESS_MAX_COUNT: Final = 20
NOW: Final = "now."
WORDS: Final = "words"  # member of a message with the words of its texts
# Parts of a run that are sent separately: each is longer than all the rest, and changes on its own.
APART: Final = ("plan", "views", "table", "parts", "alarms", "acts")


class TooManyWatchersError(Exception):
    """More browsers look than the page has room for."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A piece of what is known, as it goes to browsers.

    Attributes
    ----------
    text : as JSON
    words : by language, the words of its texts by their English
    """

    text: str
    words: Mapping[str, Mapping[str, str]]


@dataclass(slots=True, eq=False)
class BrowserWatch:
    """A connected browser. Data it has not read yet are replaced, never queued.

    Attributes
    ----------
    owner : name of the account
    address : address of the browser
    language : language of the person
    waiting : messages by kind, in the order in which they came
    """

    owner: str = ""
    address: str = ""
    language: str = "en"
    waiting: dict[str, Piece] = field(default_factory=dict)
    has_more: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, kind: str, piece: Piece) -> None:
        """Leave a message."""
        self.waiting[kind] = piece
        self.has_more.set()

    def take(self) -> Iterator[tuple[str, str]]:
        """Yield kind and JSON of the waiting data; the pieces of *Now* are one object, by name."""
        waiting, self.waiting = self.waiting, {}
        self.has_more.clear()
        pieces = [kind for kind in waiting if kind.startswith(NOW)]
        if pieces:
            found = {kind[len(NOW) :]: waiting.pop(kind) for kind in pieces}
            members = [f"{json.dumps(name)}:{piece.text}" for name, piece in found.items()]
            words: dict[str, str] = {}
            for piece in found.values():
                words |= piece.words[self.language]
            if words:
                members.append(f'"{WORDS}":{_dumped(words)}')
            yield "now", "{" + ",".join(members) + "}"
        yield from ((kind, piece.text) for kind, piece in waiting.items())


class Live:
    """Present knowledge of the cell.

    Parameters
    ----------
    runs_dir : folder of all runs
    started : last start by the page, as JSON
    clock : UTC, seconds since 1970
    """

    def __init__(
        self,
        runs_dir: Path,
        started: Callable[[], dict[str, Any] | None] = lambda: None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._started = started
        self._runs_dir = runs_dir
        self._journal = runs_dir / JOURNAL_NAME
        self._clock = clock
        self._cell = RunningCell(runs_dir)
        self._mark: tuple[object, ...] = ()
        self._watchers: set[BrowserWatch] = set()
        self._sent: dict[str, Piece] = {}
        self._shown: tuple[RunFold | None, int] = (None, -1)
        self._drawn: tuple[object, ...] = ()
        self._is_over = False
        self._status: StatusReply | None = None
        self._why_no_status = ""
        self._holder: Holder | None = None
        self._asked_s: float | None = None
        self._looked_s = self._answered_s = time.monotonic()
        self._left: tuple[Held, ...] = ()
        self._left_mark: tuple[object, ...] = ()
        self._why_no_journal = ""
        self._has_run = False
        self._ask_again = asyncio.Event()
        self.fold: RunFold | None = None
        self.scene: CellScene | None = None

    async def run(self) -> None:
        """Poll until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._follow_journal())
            tasks.create_task(self._follow_status())

    async def watch(
        self, owner: str = "", address: str = "", language: str = "en"
    ) -> AsyncIterator[tuple[str, str]]:
        """Yield the present state, then each change: its kind and its JSON.

        Parameters
        ----------
        owner : name of the account that looks
        address : address of its browser
        language : language of the person

        Raises
        ------
        TooManyWatchersError : there are as many already as the page has room for, in all, of this
            account or of this address
        """
        if self._is_over:
            return
        own = sum(one.owner == owner for one in self._watchers) if owner else 0
        near = sum(one.address == address for one in self._watchers) if address else 0
        if (
            len(self._watchers) >= WATCHER_MAX_COUNT
            or own >= WATCHER_OF_ONE_MAX_COUNT
            or near >= WATCHER_OF_ADDRESS_MAX_COUNT
        ):
            raise TooManyWatchersError
        watcher = BrowserWatch(owner, address, language)
        for kind, piece in self._sent.items():
            watcher.put(kind, piece)
        self._watchers.add(watcher)
        loop = asyncio.get_running_loop()
        beat_s = loop.time() + BEAT_WALL_S
        try:
            while True:
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(beat_s):
                        await watcher.has_more.wait()
                if self._is_over:
                    return
                for kind, message in tuple(watcher.take()):
                    yield kind, message
                if loop.time() >= beat_s:  # however much else goes out
                    beat_s = loop.time() + BEAT_WALL_S
                    yield "beat", json.dumps({"age_s": round(self.age_s, 1)})
        finally:
            self._watchers.discard(watcher)

    @property
    def is_preparing(self) -> bool:
        """Whether no run can be asked yet: the cell is free, or a run has its lock and no row."""
        return self._status is None and (not self._has_run or self._preparing() is not None)

    @property
    def age_s(self) -> float:
        """Age of the data on screen: since the journal was read, and the cell polled [wall s]."""
        return time.monotonic() - min(self._looked_s, self._answered_s)

    def hang_up(self) -> None:
        """End every stream, and begin no other: the page ends."""
        self._is_over = True
        for watcher in self._watchers:
            watcher.has_more.set()

    def refresh(self) -> None:
        """Have the status read at once, after an order."""
        self._ask_again.set()

    async def _follow_journal(self) -> None:
        while True:
            try:
                has_new = await asyncio.to_thread(self.look)
            except (JournalError, OSError) as error:
                has_new, self._why_no_journal = False, str(error)
            else:
                self._why_no_journal, self._looked_s = "", time.monotonic()
            if has_new:
                self._ask_again.set()
            self.publish()
            await asyncio.sleep(POLL_WALL_S)

    async def _follow_status(self) -> None:
        while True:
            self._ask_again.clear()
            self._holder = None
            self._asked_s = time.monotonic()
            try:
                self._status = await asyncio.to_thread(self._cell.status)
                self._has_run, self._why_no_status = True, ""
            except NoRunError:
                self._status, self._has_run, self._why_no_status = None, False, ""
            except NotServedError as error:
                self._status, self._has_run, self._why_no_status = None, True, str(error)
                self._holder = error.holder
            except ControlError as error:
                self._status, self._has_run, self._why_no_status = None, True, str(error)
            except OSError as error:
                self._status, self._has_run, self._why_no_status = None, False, str(error)
            self._asked_s, self._answered_s = None, time.monotonic()
            await self._find_left()
            self.publish()
            with suppress(TimeoutError):
                async with asyncio.timeout(STATUS_WALL_S):
                    await self._ask_again.wait()
            await asyncio.sleep(POLL_WALL_S)

    async def _find_left(self) -> None:
        """Find the parts that a finished run left in a gripper; none while a run works."""
        fold, status = self.fold, self._status
        is_decided = status is not None and status.state not in UNDECIDED
        if fold is None or fold.began is None or is_decided:
            self._left, self._left_mark = (), ()
            return
        mark = (fold.run, fold.seq)
        if mark == self._left_mark:
            return
        with suppress(JournalError, OSError):  # why it cannot be read is shown already
            self._left = await asyncio.to_thread(left_in_grippers, self._journal, fold.began)
            self._left_mark = mark
            if self._left and self._left[0].run != fold.run and not fold.part.number:
                before = await asyncio.to_thread(fold_of, self._journal, self._left[0].run)
                fold.arm, fold.part = JournaledArm(before.arm.q), before.part

    def look(self) -> bool:
        """Take new rows of the journal; return whether anything has changed."""
        mark = journal_mark(self._journal)
        if mark == self._mark:
            return False
        if not self._journal.is_file():
            self._mark, self.fold, self.scene = mark, None, None
            return True
        run = newest_run(self._journal)
        if run is None:
            self._mark = mark
            return False
        fold = self.fold
        if fold is None or fold.run != run or (self._mark and self._mark[0] != mark[0]):
            fold = RunFold(run)
        has_new = False
        for row in read_rows_after(self._journal, fold.seq, run):
            fold.take(row)
            has_new = True
        if self.fold is not fold:
            self.scene = _scene_of(fold)
        self.fold, self._mark = fold, mark
        return has_new

    def publish(self) -> None:
        """Pass on all changes."""
        fold, scene = self.fold, self.scene
        for name, piece in self._cell_facts().items():
            self._put(NOW + name, piece)
        mark = (fold, -1 if fold is None else fold.seq)
        if mark != self._shown or f"{NOW}run" not in self._sent:
            self._shown = mark
            self._publish_run(fold)
        if fold is None or scene is None:
            return
        first = self._first_motion()
        drawn = (fold, fold.seq, first)
        if drawn == self._drawn and fold.arm.path is None:
            return  # what stands still looks as it did
        self._drawn = drawn
        # a paused arm was asked where it stands; the journal has only the path that it is on
        arm = JournaledArm(first[0]) if first else fold.arm
        self._put("moment", scene.moment(arm, fold.part, self._clock(), fold.speed))
        ghost = scene.ghost(fold.part, first) if first else None
        self._put("ghost", {"motion": ghost})

    def _publish_run(self, fold: RunFold | None) -> None:
        """Pass on the changes of the run; called after a row of it, or without one."""
        if fold is None:
            self._put(f"{NOW}run", None)
            return
        found = fold.facts()
        for name in APART:
            self._put(f"{NOW}run.{name}", found.pop(name))
        self._put(f"{NOW}run", found)
        self._put("coverage", fold.coverage())

    def _first_motion(self) -> Waypoints:
        """Return the first joints of the arm when the pause ends; () if it does not move."""
        first = None if self._status is None else self._status.first_motion
        return () if first is None else first.waypoints

    def _put(self, kind: str, message: object) -> None:
        text = _dumped(message)
        if kind in self._sent and self._sent[kind].text == text:
            return
        # the others have names alone, and very many figures
        told = LANGUAGES if kind.startswith(NOW) else ()
        self._sent[kind] = Piece(text, {one: words_in(one, message) for one in told})
        for watcher in self._watchers:
            watcher.put(kind, self._sent[kind])

    def now(self) -> dict[str, Any]:
        """Return the state of the cell and its last run, as JSON."""
        return {**self._cell_facts(), "run": None if self.fold is None else self.fold.facts()}

    def _cell_facts(self) -> dict[str, Any]:
        """Return the page's data on the cell itself, as JSON."""
        status, silent = self._status, self._why_no_status
        if self._asked_s is not None and time.monotonic() - self._asked_s > FRESH_WALL_S:
            status, silent = (
                None,
                say("no answer for {fresh_wall_s:.0f} s", fresh_wall_s=FRESH_WALL_S),
            )
        left, is_ending = unfinished(self._left), self._is_ending()
        state = self.fold.state if self.fold is not None else ""
        if status is not None:
            state = status.state
        preparing = self._preparing()
        return {
            "runs": self._has_run,
            "preparing": preparing,
            "silent": "" if preparing or is_ending else silent,
            "ending": is_ending,
            "journal": self._why_no_journal,
            "state": state,
            "light": _light(status, self._has_run, state, bool(preparing) or is_ending, left),
            "unfinished": left,
            "status": None if status is None else _status(status),
            "started": self._started(),
        }

    def _is_ending(self) -> bool:
        """Return whether the run at rest has the cell still: it writes its report."""
        fold, holder = self.fold, self._holder
        is_this = holder is not None and fold is not None and fold.run == holder.run
        return is_this and fold is not None and fold.is_at_rest

    def _preparing(self) -> dict[str, Any] | None:
        """Return the run in preparation, and its user: it has the lock, and no row yet."""
        holder = self._holder
        if holder is None or (self.fold is not None and self.fold.run == holder.run):
            return None
        return {"run": holder.run, "user": holder.user, "pid": holder.pid, "since": holder.since}


def _dumped(content: object) -> str:
    return json.dumps(content, ensure_ascii=False, separators=(",", ":"))


def _light(
    status: StatusReply | None,
    has_run: bool,
    state: str,
    is_between: bool,
    left: dict[str, Any] | None,
) -> str:
    has_question = status is not None and status.question is not None
    if left is not None and not has_question:
        return "fault"
    return "resting" if is_between else light_of(status, has_run, state)


def light_of(status: StatusReply | None, has_run: bool, state: str) -> str:
    """Return the light of the stack: fault, attention, question, working, resting or off.

    Parameters
    ----------
    status : status of the running cell, None without one
    has_run : somebody has the cell
    state : state of the machine
    """
    mode = state.partition("_")[0]
    if mode in ("aborting", "aborted"):
        return "fault"
    if not has_run:
        return "off"
    if status is None:
        return "attention"
    if status.question is not None:
        return "question"
    if mode in ("suspending", "suspended", "unsuspending", "holding", "held", "stopping"):
        return "attention"
    return "working" if mode in ("execute", "completing", "resetting", "starting") else "resting"


def _status(status: StatusReply) -> dict[str, Any]:
    """Return a status as JSON, its alarms with the actions for a person."""
    found = facts(status)
    del found["at_s"]  # changes with each reading, and nobody looks at it
    alarms = []
    for text in status.alarms:
        number, _, words = text.partition(" ")
        alarm = BY_NUMBER.get(int(number)) if number.isdigit() else None
        alarms.append(
            {
                "number": int(number) if number.isdigit() else 0,
                "words": words,
                "message": status.message,
                "severity": "" if alarm is None else alarm.severity.value,
                "unknown": "" if alarm is None else alarm.unknown,
                "todo": "" if alarm is None else alarm.action,
            }
        )
    if found["first_motion"] is not None:
        del found["first_motion"]["waypoints"]  # drawn in the scene, by a message of its own
    return {**found, "alarms": alarms}


def _scene_of(fold: RunFold) -> CellScene | None:
    if fold.began is None:
        return None
    try:
        return CellScene.of(fold.began.cell)
    except Exception:  # a scene less; a driver of another make may raise anything
        log.exception("the cell of run %s cannot be drawn", fold.run)
        return None
