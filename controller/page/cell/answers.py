"""Answers of *Cell*: the state of the cell, its pictures, and the doctor's findings."""

from __future__ import annotations

import asyncio
import re
from datetime import UTC, datetime
from typing import Any, Final

from pydantic import Field
from starlette.responses import Response

from controller.cell.lock import LOCK_NAME, read_holder
from controller.config import ConfigError, load_cell
from controller.config.files import file_within
from messages import say

from ..frame import GetRoute, JsonAnswer, NoBody, PostBody, PostRoute, Setting, Visit, refused, word
from ..frame.drawn import picture_bytes
from ..security import Role
from ..work import BusyError, Workshop
from .cells import EVIDENCE_KINDS, CellFile, CellFiles, History, cell_facts, evidence, named
from .pictures import LastPictures, live_facts

MAX_KEY: Final = 300
LIVE: Final = "live"  # kind of the last pictures requested, of whichever cell
WATCHED: Final = ("--watch", "300")  # seconds; then the lock is free again by itself
LIVE_PICTURE: Final = re.compile(r"(?:overhead|inspection)-[a-z_]{1,40}-\d{6,9}\.png")


class CellBody(PostBody):
    """A cell by its key."""

    cell: str = Field(min_length=1, max_length=MAX_KEY)


class CellAnswers:
    """The screen *Cell*.

    Parameters
    ----------
    setting : start options of the page
    workshop : working folder of the doctor
    """

    def __init__(self, setting: Setting, workshop: Workshop) -> None:
        self._runs_dir = setting.runs_dir
        self._files = CellFiles(setting.project_dir)
        self._history = History(setting.runs_dir)
        self._pictures = LastPictures(setting.runs_dir)
        self._looking = asyncio.Lock()
        self._workshop = workshop

    @property
    def every(self) -> tuple[GetRoute | PostRoute, ...]:
        """All answers."""
        return (
            GetRoute("", self.page),
            GetRoute("facts", self.facts),
            GetRoute("pictures", self.pictures),
            GetRoute("picture/{run:str}/{number:int}", self.picture),
            GetRoute("evidence", self.evidence),
            GetRoute("doctor", self.doctor),
            GetRoute("live", self.live, Role.ENGINEER),
            GetRoute("live/{file:str}", self.live_picture, Role.ENGINEER),
            PostRoute("examine", CellBody, self.examine, Role.ENGINEER),
            PostRoute("watch", CellBody, self.watch, Role.ENGINEER),
            PostRoute("cancel", NoBody, self.cancel, Role.ENGINEER),
        )

    async def page(self, visit: Visit) -> Response:
        """Return the page."""
        return visit.html("cell.html.j2")

    async def facts(self, visit: Visit) -> Response:
        """Return the state of a cell; of the first one where none is named."""
        key = visit.request.query_params.get("cell", "")

        def work() -> dict[str, Any] | None:
            every = self._files.all()
            file = named(every, key)
            if file is None:
                return None
            found = cell_facts(self._files, file, self._history.past(), datetime.now(UTC))
            return found | {"cells": [one.key for one in every]}

        async with self._looking:
            found = await asyncio.to_thread(work)
        if found is None:
            return _missing()
        holder = read_holder(self._runs_dir / LOCK_NAME)
        return JsonAnswer(found | {"holder": "" if holder is None else str(holder)})

    async def pictures(self, _: Visit) -> Response:
        """Return the last pictures of the newest run, measured."""
        async with self._looking:
            return JsonAnswer(await asyncio.to_thread(self._pictures.facts))

    async def picture(self, visit: Visit) -> Response:
        """Return one of the last pictures; its file is named by the journal alone."""
        params = visit.request.path_params
        path = (
            self._pictures.file(params["number"]) if params["run"] == self._pictures.run else None
        )
        found = None if path is None else await asyncio.to_thread(picture_bytes, path)
        return _missing() if found is None else Response(found, media_type="image/jpeg")

    async def evidence(self, visit: Visit) -> Response:
        """Return a file of the commissioning as a download; the page never executes it."""
        params = visit.request.query_params
        name = params.get("name", "")

        def work() -> tuple[bytes, str] | None:
            file = self._files.find(params.get("cell", ""))
            if file is None:
                return None
            try:
                folder = self._files.commissioned(file, load_cell(file.path))
                path = file_within(folder.path, name) if name in evidence(folder) else None
                return None if path is None else (path.read_bytes(), path.suffix)
            except (ConfigError, OSError):
                return None

        found = await asyncio.to_thread(work)
        if found is None:
            return _missing()
        short = "".join(c if c.isalnum() or c in "._-" else "_" for c in name)
        headers = {"Content-Disposition": f'attachment; filename="{short}"'}
        return Response(found[0], media_type=EVIDENCE_KINDS[found[1]], headers=headers)

    async def doctor(self, visit: Visit) -> Response:
        """Return the doctor's last findings on a cell, and whether a check is under way."""
        key = visit.request.query_params.get("cell", "")
        work = self._workshop.last("doctor", key)
        running = self._workshop.running
        return JsonAnswer(
            {
                "running": None if running is None else running.facts(),
                "work": None if work is None else work.facts(),
                "checks": [] if work is None else [one for one in work.bodies() if "check" in one],
            }
        )

    async def live(self, _: Visit) -> Response:
        """Return the pictures that the doctor has just taken, measured."""
        work = self._workshop.last("live", LIVE)
        if work is None:
            return JsonAnswer({"work": None, "pictures": [], "failed": []})

        def found() -> dict[str, Any]:
            bodies = work.bodies()
            failed = [one for one in bodies if one.get("ok") is False]
            return {"pictures": live_facts(bodies, work.folder), "failed": failed}

        return JsonAnswer({"work": work.facts(), **await asyncio.to_thread(found)})

    async def live_picture(self, visit: Visit) -> Response:
        """Return one of the pictures that the doctor has just taken."""
        work, name = self._workshop.last("live", LIVE), visit.request.path_params["file"]
        if work is None or not LIVE_PICTURE.fullmatch(name):
            return _missing()
        found = await asyncio.to_thread(picture_bytes, work.folder / name)
        return _missing() if found is None else Response(found, media_type="image/jpeg")

    async def watch(self, visit: Visit, body: CellBody) -> Response:
        """Have the doctor take pictures for minutes under the cell's lock; return that work."""
        return await self._asked(visit, body, LIVE)

    async def examine(self, visit: Visit, body: CellBody) -> Response:
        """Have the doctor look at the devices under the cell's lock; return that work."""
        return await self._asked(visit, body, "doctor")

    async def _asked(self, visit: Visit, body: CellBody, kind: str) -> Response:
        file = await asyncio.to_thread(self._files.find, body.cell)
        if file is None:
            return _missing()
        holder = read_holder(self._runs_dir / LOCK_NAME)
        if holder is not None:
            return refused(409, say("the cell is busy: {holder} has it", holder=holder))
        return self._examined(visit, file, kind)

    def _examined(self, visit: Visit, file: CellFile, kind: str) -> Response:
        path, runs = str(file.path.resolve()), str(self._runs_dir.resolve())
        try:
            work = self._workshop.start(
                kind,
                LIVE if kind == LIVE else file.key,
                visit.who,
                lambda folder: (
                    *("doctor", "--cell", path, "--runs", runs, "--json"),
                    *(("--pictures", str(folder), *WATCHED) if kind == LIVE else ()),
                ),
                within=file.path.resolve().parent,
            )
        except BusyError:
            return refused(409, word("the doctor looks already; wait, or cancel it"))
        return JsonAnswer({"running": work.facts()})

    async def cancel(self, _visit: Visit, _body: NoBody) -> Response:
        """End the doctor's look; return whether there was one."""
        return JsonAnswer({"done": await self._workshop.cancel()})


def _missing() -> Response:
    return refused(404, word("there is no such cell, picture or file"))
