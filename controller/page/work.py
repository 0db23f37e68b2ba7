"""Long work for a person at the page: `cellctl` in a child process, one at a time.

The child computes from files alone and opens no device. It runs at the least priority, so that a
run on the same machine goes before it, and within limits, so that a file that somebody has sent
cannot take the machine.
"""

from __future__ import annotations

import asyncio
import json
import os
import resource
import shutil
import signal
import tempfile
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from controller.launching import CELLCTL
from messages import say
from messages.form import KEYS_ASKED, from_said

NICENESS: Final = 15
CPU_LIMIT_S: Final = 1800
WALL_LIMIT_S: Final = 3600.0
DATA_LIMIT_BYTES: Final = 6_000_000_000
FILE_LIMIT_BYTES: Final = 500_000_000
PATIENCE_S: Final = 3.0  # time from the request to end until the end by force, unless more is given
MESSAGE_MAX_COUNT: Final = 20
MESSAGE_MAX: Final = 500
KEPT_MAX_COUNT: Final = 60
OUTPUT: Final = "out.jsonl"


class BusyError(Exception):
    """Something is at work already."""


class WorkState(StrEnum):
    """Progress of work."""

    RUNNING = "running"
    DONE = "done"
    REFUSED = "refused"  # the command ended and said no
    CANCELLED = "cancelled"


@dataclass(slots=True, eq=False)
class ChildWork:
    """Something that a child process does.

    Attributes
    ----------
    kind, about : action and its subject; together they name the work
    who : name of the person who asked for it
    folder : folder for its output; its standard output is `OUTPUT` there
    mark : fingerprint of its inputs, to know later whether they have changed
    within : folder that messages leave out of the names of files
    stage, stage_s : its stage of progress as reported, and the time in it
    messages : other lines that it printed, the last ones
    seconds : time it took, or has taken so far
    """

    kind: str
    about: str
    who: str
    folder: Path
    mark: str
    within: Path | None = None
    state: WorkState = WorkState.RUNNING
    stage: str = ""
    messages: list[str] = field(default_factory=list)
    code: int | None = None
    began_s: float = field(default_factory=time.monotonic)
    took_s: float = 0.0

    @property
    def seconds(self) -> float:
        """Seconds since it began, or those that it took."""
        is_running = self.state is WorkState.RUNNING
        return time.monotonic() - self.began_s if is_running else self.took_s

    def facts(self) -> dict[str, Any]:
        """Return its data for the page, while it runs and afterwards."""
        return {
            "kind": self.kind,
            "about": self.about,
            "who": self.who,
            "state": self.state.value,
            "code": self.code,
            "stage": self.stage,
            "seconds": round(self.seconds, 1),
            "messages": self.messages,
        }

    def bodies(self) -> list[dict[str, Any]]:
        """Return the JSON objects that it printed, one from each line; [] where there are none."""
        try:
            text = (self.folder / OUTPUT).read_text(encoding="utf-8")
            found = [json.loads(line) for line in text.splitlines()]
        except (OSError, ValueError):
            return []
        return [from_said(body) for body in found if isinstance(body, dict)]


class Workshop:
    """Runs work one after the other and keeps the results until the page ends.

    Parameters
    ----------
    program : program with its first arguments; the command that starts `cellctl`
    patience_s : time from the request to end until the end by force
    """

    def __init__(
        self,
        program: tuple[str, ...] = CELLCTL,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._program = program
        self._patience_s = patience_s
        self._root: Path | None = None
        self._kept: dict[tuple[str, str], ChildWork] = {}
        self._running: ChildWork | None = None
        self._task: asyncio.Task[None] | None = None
        self._process: asyncio.subprocess.Process | None = None

    @asynccontextmanager
    async def open(self) -> AsyncIterator[None]:
        """Have a folder for results while the page is served; end running work afterwards."""
        self._root = Path(tempfile.mkdtemp(prefix="cellctl-page-"))
        try:
            yield
        finally:
            await self.cancel()
            shutil.rmtree(self._root, ignore_errors=True)
            self._root = None

    @property
    def running(self) -> ChildWork | None:
        """The work in progress."""
        return self._running

    def last(self, kind: str, about: str) -> ChildWork | None:
        """Return the last work of a kind on something, also while it runs."""
        return self._kept.get((kind, about))

    def start(
        self,
        kind: str,
        about: str,
        who: str,
        arguments: Callable[[Path], tuple[str, ...]],
        *,
        mark: str = "",
        within: Path | None = None,
        then: Callable[[ChildWork], None] | None = None,
    ) -> ChildWork:
        """Start work and return it.

        Parameters
        ----------
        kind, about, who, mark : as in `ChildWork`
        arguments : return those of `cellctl`, given the folder for what it writes
        within : folder that messages leave out of the names of files
        then : is called with the work when it has ended, in a thread

        Raises
        ------
        BusyError : something is at work already
        ValueError : the workshop is not open
        """
        if self._running is not None:
            raise BusyError(f"{self._running.kind} of {self._running.about}")
        if self._root is None:
            raise ValueError("the workshop is not open")
        work = ChildWork(kind, about, who, Path(tempfile.mkdtemp(dir=self._root)), mark, within)
        self._running = work
        self._keep(work)
        command = (*self._program, *arguments(work.folder))
        self._task = asyncio.create_task(self._run(work, command, then))
        return work

    async def ended(self) -> None:
        """Wait until nothing is at work."""
        if self._task is not None:
            await asyncio.wait([self._task])

    async def cancel(self) -> bool:
        """End the work in progress and wait for its end; return False if there was none."""
        work, task = self._running, self._task
        if work is None or task is None:
            return False
        work.state = WorkState.CANCELLED
        self._signal(signal.SIGTERM)
        done, _ = await asyncio.wait([task], timeout=self._patience_s)
        if not done:
            self._signal(signal.SIGKILL)
            await asyncio.wait([task])
        return True

    def _keep(self, work: ChildWork) -> None:
        old = self._kept.pop((work.kind, work.about), None)
        self._kept[work.kind, work.about] = work
        while len(self._kept) > KEPT_MAX_COUNT:
            oldest = next(iter(self._kept))
            shutil.rmtree(self._kept.pop(oldest).folder, ignore_errors=True)
        if old is not None:
            shutil.rmtree(old.folder, ignore_errors=True)

    def _signal(self, number: signal.Signals) -> None:
        process = self._process
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, number)

    async def _run(
        self, work: ChildWork, command: tuple[str, ...], then: Callable[[ChildWork], None] | None
    ) -> None:
        try:
            async with asyncio.timeout(WALL_LIMIT_S):
                await self._child(work, command)
        except TimeoutError:
            self._signal(signal.SIGKILL)
            work.messages.append(say("ended after {wall_limit_s:.0f} s", wall_limit_s=WALL_LIMIT_S))
        except OSError as error:
            work.messages.append(
                say("cannot be started: {strerror}", strerror=error.strerror or error)
            )
        finally:
            if work.state is not WorkState.CANCELLED:
                # a command that says no ends with 1 and has printed what it found
                work.state = WorkState.DONE if work.code == 0 else WorkState.REFUSED
            try:
                if then is not None:
                    await asyncio.to_thread(then, work)
            finally:
                work.took_s = time.monotonic() - work.began_s
                self._running = self._task = self._process = None

    async def _child(self, work: ChildWork, command: tuple[str, ...]) -> None:
        with (work.folder / OUTPUT).open("xb") as output:
            process = await asyncio.create_subprocess_exec(
                *command,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=output,
                stderr=asyncio.subprocess.PIPE,
                start_new_session=True,
                env={**os.environ, KEYS_ASKED: "1"},
            )
        self._process = process
        _limit(process.pid)
        if work.state is WorkState.CANCELLED:  # before there was a process to be told
            self._signal(signal.SIGTERM)
        assert process.stderr is not None
        while True:
            try:
                line = await process.stderr.readline()
            except ValueError:  # longer than any line that is of use
                continue
            if not line:
                break
            _note(work, line.decode(errors="replace").strip())
        work.code = await process.wait()


def _limit(pid: int) -> None:
    """Limit a child's use of the machine."""
    with suppress(OSError):  # this process gives way to others even more
        os.setpriority(os.PRIO_PROCESS, pid, NICENESS)
    with suppress(OSError):  # it has ended already
        resource.prlimit(pid, resource.RLIMIT_CPU, (CPU_LIMIT_S, CPU_LIMIT_S + 5))
        resource.prlimit(pid, resource.RLIMIT_DATA, (DATA_LIMIT_BYTES, DATA_LIMIT_BYTES))
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (FILE_LIMIT_BYTES, FILE_LIMIT_BYTES))
        resource.prlimit(pid, resource.RLIMIT_CORE, (0, 0))


def _note(work: ChildWork, line: str) -> None:
    """Take a line of standard error: progress, or a message for the person."""
    if work.within is not None:
        line = line.replace(f"{work.within}/", "")
    try:
        body = json.loads(line)
        said = from_said(body) if isinstance(body, dict) else {}
    except ValueError:
        said = {}
    if said.get("event") == "progress":
        work.stage = _short(said.get("stage"))
    elif line:
        is_refusal = said.get("event") == "refused"
        message = said.get("error") if is_refusal else line.removeprefix("cellctl: ")
        work.messages.append(_short(message))
        del work.messages[:-MESSAGE_MAX_COUNT]


def _short(text: object) -> str:
    """Return a text that a child printed; one that is too long is cut, and loses its key."""
    found = text if isinstance(text, str) else ""
    return found if len(found) <= MESSAGE_MAX else found[:MESSAGE_MAX]
