"""Starts `cellctl run` as a process of its own, which outlives the one that starts it.

The process has a session of its own and ignores SIGHUP, so that neither the end of its parent nor
of a terminal reaches it. Its output goes to a file in the folder of runs, whose end is shown until
the run itself can be polled. Questions of the run wait for an answer.
"""

import asyncio
import contextlib
import os
import secrets
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, TypeVar

from controller.cell.lock import LOCK_NAME, Holder, read_holder
from controller.config import ConfigError
from controller.config.files import write_whole
from messages import say

from .choices import Choices, choices_of
from .request import RunRequest

LOG_FOLDER: Final = "started"
LOG_MAX_COUNT: Final = 50
LIST_KEPT_COUNT: Final = 20
LAST_NAME: Final = "last.json"  # file of the last batch started here, for `Same again`
SHOWN_MAX_BYTES: Final = 6_000
SHOWN_LINE_COUNT: Final = 30
CELLCTL: Final = (sys.executable, "-m", "controller.cli")
# Ignores SIGHUP, which an `exec` keeps, and becomes the command; its words are never parsed.
DETACHED: Final = ("/bin/sh", "-c", 'trap "" HUP; exec "$@"', "sh")

T = TypeVar("T")


class LaunchRefusedError(Exception):
    """A run is not started; the message says why.

    Attributes
    ----------
    status : status of HTTP that says so: 409 for now, 422 for this request, 507 for want of room
    """

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


@dataclass(slots=True, eq=False)
class StartedRun:
    """A run that was started.

    Attributes
    ----------
    recipes, who : recipes, and the user who gets them
    began : UTC
    log : file of what it prints
    code : its exit code, None while it works
    """

    recipes: str
    who: str
    began: str
    log: Path
    process: subprocess.Popen[bytes]
    code: int | None = None
    _read: tuple[int, list[str]] = (-1, [])

    def facts(self) -> dict[str, Any]:
        """Return its data for the page, as JSON."""
        if self.code is None:
            self.code = self.process.poll()
        size = self.log.stat().st_size if self.log.exists() else 0
        if size != self._read[0]:
            self._read = (size, _last_lines(self.log))
        return {
            "recipes": self.recipes,
            "who": self.who,
            "began": self.began,
            "code": self.code,
            "lines": self._read[1],
        }


class Launcher:
    """Starts runs, one at a time.

    Parameters
    ----------
    runs_dir : folder of all runs
    project_dir : folder of recipes and cell files, in which the commands run
    command : command line that runs `cellctl`
    now : UTC
    more : options that every run gets
    executor : a thread of it starts the runs, which get its priority; None for any thread
    """

    def __init__(
        self,
        runs_dir: Path,
        project_dir: Path,
        command: tuple[str, ...] = CELLCTL,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        more: tuple[str, ...] = (),
        executor: Executor | None = None,
    ) -> None:
        self._runs_dir = runs_dir.absolute()
        self._project_dir = project_dir.absolute()
        self._command = command
        self._now = now
        self._more = more
        self._executor = executor
        self._one_at_a_time = asyncio.Lock()
        self._work: StartedRun | None = None
        self._lists: dict[str, tuple[str, Path]] = {}

    async def keep_list(self, name: str, write: Callable[[Path, Choices], T]) -> tuple[str, T]:
        """Keep a list of parts for a start; return its key, and what `write` returns.

        Parameters
        ----------
        name : of the list, for people
        write : writes a file that does not exist yet as `cellctl run --parts-list` takes it; may
            raise

        Raises
        ------
        LaunchRefusedError : it cannot be kept
        """
        key = secrets.token_hex(8)
        folder = self._runs_dir / LOG_FOLDER
        path = folder / f"list-{key}.csv"
        choices = await self.choices()

        def keep() -> T:
            folder.mkdir(parents=True, exist_ok=True)
            try:
                return write(path, choices)
            except Exception:
                path.unlink(missing_ok=True)
                raise

        try:
            found = await asyncio.to_thread(keep)
        except OSError as error:
            raise LaunchRefusedError(507, f"{path}: {error.strerror}") from error
        self._lists[key] = (name, path)
        while len(self._lists) > LIST_KEPT_COUNT:
            _, old = self._lists.pop(next(iter(self._lists)))
            await asyncio.to_thread(old.unlink, missing_ok=True)
        return key, found

    async def choices(self) -> Choices:
        """Return the choices for a start."""
        return await asyncio.to_thread(choices_of, self._project_dir)

    async def start(self, body: RunRequest, who: str) -> None:
        """Start a run in the name of an account.

        Parameters
        ----------
        body : run to start
        who : name of the account

        Raises
        ------
        LaunchRefusedError : a run is on, another start goes on, or there is no such recipe or
            cell file
        """
        async with self._one_at_a_time:
            if self._work is not None and self._work.process.poll() is None:
                raise LaunchRefusedError(409, "the run that was started here has not ended yet")
            lock = self._runs_dir / LOCK_NAME
            holder: Holder | None = await asyncio.to_thread(read_holder, lock)
            if holder is not None:
                raise LaunchRefusedError(409, say("{holder} has the cell", holder=holder))
            require_known(body, await self.choices())
            if body.parts_list and body.parts_list not in self._lists:
                raise LaunchRefusedError(
                    409, "the list of parts is not there any more; send it again"
                )
            loop = asyncio.get_running_loop()
            self._work = await loop.run_in_executor(self._executor, self._spawn, body, who)
            await asyncio.to_thread(self._remember, body)

    async def last(self) -> RunRequest | None:
        """Return the last batch that can be repeated; None before the first."""
        return await asyncio.to_thread(self._last)

    async def cancel(self) -> None:
        """End the preparation of the run that was started here, as Ctrl-C at a terminal does.

        By SIGTERM, which has the same effect on a run: a page that a script has put into the
        background ignores SIGINT, and so do its child processes.

        Raises
        ------
        LaunchRefusedError : there is none
        """
        if self._work is None or self._work.process.poll() is not None:
            raise LaunchRefusedError(409, "no run is being prepared that was started here")
        self._work.process.send_signal(signal.SIGTERM)

    def _last(self) -> RunRequest | None:
        try:
            found = RunRequest.model_validate_json(
                (self._runs_dir / LOG_FOLDER / LAST_NAME).read_bytes()
            )
        except (OSError, ValueError):  # none yet, or of another version: the form is empty
            return None
        return found.again

    def _remember(self, body: RunRequest) -> None:
        """Keep a batch for the next start; without room for it, the form does not remember it."""
        if body.again is not None:
            with contextlib.suppress(ConfigError):
                write_whole(self._runs_dir / LOG_FOLDER / LAST_NAME, body.model_dump_json())

    def facts(self) -> dict[str, Any] | None:
        """Return the last run that was started here, as JSON; None before the first."""
        return None if self._work is None else self._work.facts()

    def _spawn(self, body: RunRequest, who: str) -> StartedRun:
        folder = self._runs_dir / LOG_FOLDER
        began = self._now()
        log = folder / f"{f'{began:%Y%m%d-%H%M%S-%f}'}.log"
        recipes = [one.word for one in body.recipes]
        name, parts_list = self._lists.get(body.parts_list, ("", None))
        # its questions wait for an answer at the page, or at another terminal
        options = [*body.options(who, parts_list), *self._more, "--wait"]
        options.append(f"--runs={self._runs_dir}")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for old in sorted(folder.glob("*.log"))[: -LOG_MAX_COUNT + 1]:
                with contextlib.suppress(FileNotFoundError):
                    old.unlink()
            with log.open("xb") as to:
                process = subprocess.Popen(
                    [*DETACHED, *self._command, "run", *options, "--", *recipes],
                    stdin=subprocess.DEVNULL,
                    stdout=to,
                    stderr=subprocess.STDOUT,
                    cwd=self._project_dir,
                    env={**os.environ, "COLUMNS": "110", "NO_COLOR": "1"},
                    start_new_session=True,
                )
        except OSError as error:
            raise LaunchRefusedError(507, f"{log}: {error.strerror}") from error
        return StartedRun(name or " ".join(recipes), who, began.isoformat(), log, process)


def require_known(body: RunRequest, choices: Choices) -> None:
    """Check that recipes and cell file of a start are among those that it may name.

    Parameters
    ----------
    body : body of the start
    choices : allowed names

    Raises
    ------
    LaunchRefusedError : one of them is not, or cannot be used
    """
    named = [(one.recipe, choices.recipe(one.recipe)) for one in body.recipes]
    for name, found in (*named, *([(body.cell, choices.cell(body.cell))] if body.cell else [])):
        if found is None:
            raise LaunchRefusedError(
                422, say("`{name}`: there is no such file in the project", name=name)
            )
        if found.problem:
            raise LaunchRefusedError(422, found.problem)


def _last_lines(log: Path) -> list[str]:
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - SHOWN_MAX_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return []
    lines = [line.rstrip() for line in text.splitlines()]
    return [line for line in lines if line][-SHOWN_LINE_COUNT:]
