"""Starts `cellctl run` as a process of its own, which outlives the page.

The process has a session of its own and ignores SIGHUP, so that neither the end of the page nor of
its terminal reaches it. Its output goes to a file in the folder of runs; the page shows the end of
that file until the run itself can be polled. Questions of the run wait for an answer.
"""

import asyncio
import contextlib
import os
import secrets
import signal
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from controller.cell.devices.lock import LOCK_NAME, Holder, read_holder
from controller.results.pages import write_file

from ..frame.screens import PostBody, RequestRefusedError, Setting
from ..frame.uploads import Uploaded
from ..frame.words import word
from ..work import CELLCTL
from .choices import Choices, choices_of
from .listing import write_list

LOG_FOLDER: Final = "started"
LOG_MAX_COUNT: Final = 50
LIST_KEPT_COUNT: Final = 20
LAST_NAME: Final = "last.json"  # file of the last batch started here, for `Same again`
SHOWN_MAX_BYTES: Final = 6_000
SHOWN_LINE_COUNT: Final = 30
PAPER_MAX: Final = 80
COUNT_MAX: Final = 100_000
SERIAL_MAX_COUNT: Final = 2_000
RECIPE_MAX_COUNT: Final = 20
# Ignores SIGHUP, which an `exec` keeps, and becomes the command; its words are never parsed.
DETACHED: Final = ("/bin/sh", "-c", 'trap "" HUP; exec "$@"', "sh")


def _plain(text: str) -> str:
    if not text.isprintable():
        raise ValueError("has signs that cannot be printed")
    return text


Paper = Annotated[str, Field(max_length=PAPER_MAX), AfterValidator(_plain)]


class CountedRecipe(BaseModel):
    """A recipe of a run, by its key in `Choices`, with its number of parts: None for its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    recipe: str = Field(min_length=1, max_length=300)
    count: int | None = Field(default=None, ge=1, le=COUNT_MAX)

    @property
    def word(self) -> str:
        """The arguments of the command line."""
        return self.recipe if self.count is None else f"{self.recipe}={self.count}"


class StartBody(PostBody):
    """A start, as the browser orders it; the options are those of `cellctl run`.

    Attributes
    ----------
    parts_list : key of a list that was sent, in place of recipes and serial numbers
    is_dry : all motions of one recipe without a part, lifted and slow
    cell : key of `Choices`; empty for that of the recipe
    serials, serial_from : serial numbers one by one, or the first of those that are counted
    goes_on : counting goes on after the last number of the earlier runs
    is_read : serial numbers are read off the parts
    speed, seed : speed and seed of the emulated cell
    """

    recipes: tuple[CountedRecipe, ...] = Field(default=(), max_length=RECIPE_MAX_COUNT)
    parts_list: str = Field(default="", pattern="^([0-9a-f]{16})?$")
    is_dry: bool = False
    cell: str = Field(default="", max_length=300)
    lot: Paper = ""
    order_number: Paper = ""
    serials: tuple[Annotated[Paper, Field(min_length=1)], ...] = Field(
        default=(), max_length=SERIAL_MAX_COUNT
    )
    serial_from: Paper = ""
    goes_on: bool = False
    is_read: bool = False
    part_temperature_c: float | None = Field(default=None, ge=-50, le=150)
    speed: float = Field(default=1.0, ge=0.1, le=100)
    seed: int | None = Field(default=None, ge=0, lt=2**32)
    are_trays_empty: bool = False
    is_part_removed: bool = False

    @model_validator(mode="after")
    def _one_source_of_serials(self) -> "StartBody":
        if bool(self.recipes) == bool(self.parts_list):
            raise ValueError("recipes, or a list of parts: one of these")
        sources = (self.serials, self.serial_from, self.is_read, self.parts_list)
        if sum(map(bool, sources)) > 1:
            raise ValueError("serial numbers are listed, counted or read: one of these")
        if self.goes_on and not self.serial_from:
            raise ValueError("counting goes on across runs only where numbers are counted")
        return self

    @model_validator(mode="after")
    def _no_part_of_a_dry_run(self) -> "StartBody":
        of_a_part = (
            self.lot, self.order_number, self.parts_list, self.serials, self.serial_from,
            self.is_read, self.part_temperature_c is not None, self.are_trays_empty,
            self.is_part_removed, *(one.count for one in self.recipes),
        )  # fmt: skip
        if self.is_dry and (len(self.recipes) != 1 or any(of_a_part)):
            raise ValueError("a dry run is of one recipe, and has no part")
        return self

    @property
    def again(self) -> "StartBody | None":
        """The same batch once more; None where that is impossible: each part has its number once.

        Counted numbers continue after the last one. A person's statements on the grippers and the
        trays held at that time, and are not repeated.
        """
        if self.serials or self.parts_list or self.is_dry:
            return None
        stated = {"are_trays_empty": False, "is_part_removed": False}
        return self.model_copy(update={**stated, "goes_on": bool(self.serial_from)})

    def options(self, who: str, parts_list: Path | None = None) -> list[str]:
        """Return the options of `cellctl run`; values follow `=`, so none is taken as an option.

        Parameters
        ----------
        who : the account that starts the run
        parts_list : file of the list that was sent
        """
        valued: dict[str, object] = {
            "--operator": who,
            "--lot": self.lot,
            "--order": self.order_number,
            "--cell": self.cell,
            "--serial-from": self.serial_from,
            "--part-temperature": self.part_temperature_c,
            "--seed": self.seed,
            "--parts-list": parts_list,
            "--speed": None if self.speed == 1 else self.speed,
        }
        stated = {
            "--across-runs": self.goes_on,
            "--dry": self.is_dry,
            "--scan": self.is_read,
            "--trays-empty": self.are_trays_empty,
            "--part-removed": self.is_part_removed,
        }
        return [
            *(f"{name}={value}" for name, value in valued.items() if value not in ("", None)),
            *(f"--serial={serial}" for serial in self.serials),
            *(name for name, is_stated in stated.items() if is_stated),
        ]


@dataclass(slots=True, eq=False)
class StartedRun:
    """A run that the page has started.

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
    setting : folder of runs, and the project's folder, in which the commands run
    command : command line that runs `cellctl`
    now : UTC
    """

    def __init__(
        self,
        setting: Setting,
        command: tuple[str, ...] = CELLCTL,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._runs_dir = setting.runs_dir.absolute()
        self._project_dir = setting.project_dir.absolute()
        self._command = command
        self._now = now
        self._one_at_a_time = asyncio.Lock()
        self._work: StartedRun | None = None
        self._lists: dict[str, tuple[str, Path]] = {}

    async def keep_list(self, sent: Uploaded) -> dict[str, Any]:
        """Keep a list of parts sent by a person; return its key and its content, as JSON.

        Parameters
        ----------
        sent : CSV

        Raises
        ------
        RequestRefusedError : it cannot be read or kept, or names a recipe that may not be started
        """
        key = secrets.token_hex(8)
        folder = self._runs_dir / LOG_FOLDER
        path = folder / f"list-{key}.csv"
        choices = await self.choices()

        def keep() -> Mapping[str, Any]:
            folder.mkdir(parents=True, exist_ok=True)
            try:
                return write_list(sent.path, path, choices, self._project_dir)
            except RequestRefusedError:
                path.unlink(missing_ok=True)
                raise

        try:
            found = await asyncio.to_thread(keep)
        except OSError as error:
            raise RequestRefusedError(507, f"{path}: {error.strerror}") from error
        self._lists[key] = (sent.name, path)
        while len(self._lists) > LIST_KEPT_COUNT:
            _, old = self._lists.pop(next(iter(self._lists)))
            await asyncio.to_thread(old.unlink, missing_ok=True)
        return {"key": key, "name": sent.name, **found}

    async def choices(self) -> Choices:
        """Return the choices for a start."""
        return await asyncio.to_thread(choices_of, self._project_dir)

    async def start(self, body: StartBody, who: str) -> None:
        """Start a run in the name of an account.

        Parameters
        ----------
        body : run to start
        who : name of the account

        Raises
        ------
        RequestRefusedError : a run is on, another start goes on, or there is no such recipe or
            cell file
        """
        async with self._one_at_a_time:
            if self._work is not None and self._work.process.poll() is None:
                raise RequestRefusedError(
                    409, word("the run that was started here has not ended yet")
                )
            lock = self._runs_dir / LOCK_NAME
            holder: Holder | None = await asyncio.to_thread(read_holder, lock)
            if holder is not None:
                raise RequestRefusedError(409, f"{holder} has the cell")
            require_known(body, await self.choices())
            if body.parts_list and body.parts_list not in self._lists:
                raise RequestRefusedError(
                    409, word("the list of parts is not there any more; send it again")
                )
            self._work = await asyncio.to_thread(self._spawn, body, who)
            await asyncio.to_thread(self._remember, body)

    async def last(self) -> StartBody | None:
        """Return the last batch that can be repeated; None before the first."""
        return await asyncio.to_thread(self._last)

    async def cancel(self) -> None:
        """End the preparation of the run that was started here, as Ctrl-C at a terminal does.

        By SIGTERM, which has the same effect on a run: a page that a script has put into the
        background ignores SIGINT, and so do its child processes.

        Raises
        ------
        RequestRefusedError : there is none
        """
        if self._work is None or self._work.process.poll() is not None:
            raise RequestRefusedError(409, word("no run is being prepared that was started here"))
        self._work.process.send_signal(signal.SIGTERM)

    def _last(self) -> StartBody | None:
        try:
            found = StartBody.model_validate_json(
                (self._runs_dir / LOG_FOLDER / LAST_NAME).read_bytes()
            )
        except (OSError, ValueError):  # none yet, or of another version: the form is empty
            return None
        return found.again

    def _remember(self, body: StartBody) -> None:
        """Keep a batch for the next start; without room for it, the form does not remember it."""
        if body.again is not None:
            with contextlib.suppress(OSError):
                write_file(body.model_dump_json().encode(), self._runs_dir / LOG_FOLDER / LAST_NAME)

    def facts(self) -> dict[str, Any] | None:
        """Return the last run that was started here, as JSON; None before the first."""
        return None if self._work is None else self._work.facts()

    def _spawn(self, body: StartBody, who: str) -> StartedRun:
        folder = self._runs_dir / LOG_FOLDER
        began = self._now()
        log = folder / f"{began:%Y%m%d-%H%M%S-%f}.log"
        recipes = [one.word for one in body.recipes]
        name, parts_list = self._lists.get(body.parts_list, ("", None))
        # its questions wait for an answer at the page, or at another terminal
        options = [*body.options(who, parts_list), "--wait", f"--runs={self._runs_dir}"]
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
            raise RequestRefusedError(507, f"{log}: {error.strerror}") from error
        return StartedRun(name or " ".join(recipes), who, began.isoformat(), log, process)


def require_known(body: StartBody, choices: Choices) -> None:
    """Check that recipes and cell file of a start are among those that it may name.

    Parameters
    ----------
    body : body of the start
    choices : allowed names

    Raises
    ------
    RequestRefusedError : one of them is not, or cannot be used
    """
    named = [(one.recipe, choices.recipe(one.recipe)) for one in body.recipes]
    for name, found in (*named, *([(body.cell, choices.cell(body.cell))] if body.cell else [])):
        if found is None:
            raise RequestRefusedError(422, f"`{name}`: there is no such file in the project")
        if found.problem:
            raise RequestRefusedError(422, found.problem)


def _last_lines(log: Path) -> list[str]:
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - SHOWN_MAX_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return []
    lines = [line.rstrip() for line in text.splitlines()]
    return [line for line in lines if line][-SHOWN_LINE_COUNT:]
