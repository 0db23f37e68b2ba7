"""Answers of *Now*: the stream of changes, scene, mesh, pictures, and orders to the cell."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict
from typing import Any, Final

from pydantic import Field
from starlette.responses import Response, StreamingResponse

from controller.cell.control import (
    MAX_KEY,
    MAX_WHO,
    AckOrder,
    AnswerOrder,
    ControlError,
    Order,
    PauseOrder,
    ResumeOrder,
    RunningCell,
    facts,
)
from controller.launching import Launcher, RunRequest
from messages import say

from ..frame.drawn import mesh_of, packed, packed_json, run_picture
from ..frame.screens import GetRoute, PostBody, PostRoute, Setting, Upload
from ..frame.uploads import Uploaded
from ..frame.visit import JsonAnswer, Visit, address_of, refused, worded
from ..frame.words import word
from ..security import Role
from .listing import LIST_MAX_BYTES, keep_sent
from .live import Live, TooManyWatchersError

FIRST_MAX: Final = 1000
LIST_SUFFIXES: Final = frozenset({".csv"})


class _OrderBody(PostBody):
    why: str = Field(default="", max_length=MAX_WHO)


class StartBody(RunRequest, PostBody):
    """A start, as the browser orders it."""


class CancelBody(PostBody):
    """The end of a preparation."""


class PauseBody(_OrderBody):
    """A pause, as the browser orders it."""

    kind: str = Field(pattern="^(step|safe|now)$")


class ResumeBody(_OrderBody):
    """A resume, with the first motion that the person was shown."""

    first: str | None = Field(max_length=FIRST_MAX)


class AckBody(_OrderBody):
    """An acknowledgement, which needs a reason."""

    why: str = Field(min_length=1, max_length=MAX_WHO)


class StopBody(_OrderBody):
    """A stop."""


class AnswerBody(_OrderBody):
    """An answer to the question that the person has read."""

    key: str = Field(min_length=1, max_length=MAX_KEY)
    number: int = Field(ge=1)


ORDERS: Final[tuple[tuple[str, type[_OrderBody], type[Order]], ...]] = (
    ("pause", PauseBody, PauseOrder),
    ("resume", ResumeBody, ResumeOrder),
    ("ack", AckBody, AckOrder),
    ("stop", StopBody, Order),
    ("answer", AnswerBody, AnswerOrder),
)


class NowAnswers:
    """The answers of *Now*.

    Parameters
    ----------
    setting : start options of the page
    live : current state of the cell
    launcher : starts runs
    """

    def __init__(self, setting: Setting, live: Live, launcher: Launcher) -> None:
        self._launcher = launcher
        self._setting = setting
        self._live = live
        self._cell = RunningCell(setting.runs_dir)
        self._mesh: tuple[tuple[str, str, str], bytes] | None = None
        self._acting = asyncio.Lock()

    @property
    def every(self) -> tuple[GetRoute | PostRoute | Upload, ...]:
        """All answers."""
        return (
            GetRoute("", self.now),
            GetRoute("wall", self.wall),
            GetRoute("events", self.events),
            GetRoute("scene", self.scene),
            GetRoute("mesh", self.mesh),
            GetRoute("picture/{run:str}/{number:int}", self.picture),
            GetRoute("choices", self.choices, Role.OPERATOR),
            PostRoute("start", StartBody, self.start, Role.OPERATOR),
            PostRoute("cancel", CancelBody, self.cancel, Role.OPERATOR),
            Upload("list", LIST_MAX_BYTES, LIST_SUFFIXES, self.list, Role.OPERATOR),
            *(
                PostRoute(f"act/{name}", body, self._order(name, order), Role.OPERATOR)
                for name, body, order in ORDERS
            ),
        )

    @asynccontextmanager
    async def polling(self) -> AsyncIterator[None]:
        """Look at the cell while the page is served."""
        poller = asyncio.create_task(self._live.run())
        try:
            yield
        finally:
            poller.cancel()
            with suppress(asyncio.CancelledError):
                await poller

    async def now(self, visit: Visit) -> Response:
        """Return the page of the cell's present activity."""
        return visit.html("now.html.j2")

    async def wall(self, visit: Visit) -> Response:
        """Return the same page for reading from three metres."""
        return visit.html("wall.html.j2")

    async def events(self, visit: Visit) -> Response:
        """Return a stream of the present state, then of each change, while the session lasts."""
        stream = self._live.watch(visit.account.name, address_of(visit.request), visit.language)
        try:
            first = await anext(stream, None)
        except TooManyWatchersError:
            return refused(503, word("too many browsers look already"))
        if first is None:
            return refused(503, word("the page ends"))

        async def lines() -> AsyncIterator[str]:
            yield f"retry: 1000\nevent: {first[0]}\ndata: {first[1]}\n\n"
            async for kind, message in stream:
                if not visit.is_logged_in():
                    yield "event: end\ndata: {}\n\n"
                    return
                yield f"event: {kind}\ndata: {message}\n\n"

        return StreamingResponse(
            lines(), media_type="text/event-stream", headers={"X-Accel-Buffering": "no"}
        )

    async def scene(self, visit: Visit) -> Response:
        """Return the static objects of the cell."""
        scene = self._live.scene
        if scene is None:
            return refused(404, word("there is no cell to draw"))
        return packed(packed_json(worded(scene.standing, visit.language)))

    async def mesh(self, visit: Visit) -> Response:
        """Return the part's mesh."""
        fold = self._live.fold
        if fold is None:
            return refused(404, word("there is no run"))
        began, folder = fold.began, self._setting.runs_dir / fold.run
        if began is None:
            why = {"why": say("the run has only begun")}
            return packed(packed_json(worded(why, visit.language)))
        recipe = fold.recipe
        key = (fold.run, str(recipe.get("part", "")), visit.language)
        if self._mesh is None or self._mesh[0] != key:
            found = await asyncio.to_thread(
                lambda: packed_json(worded(mesh_of(recipe, began.files, folder), visit.language))
            )
            self._mesh = (key, found)
        return packed(self._mesh[1])

    async def picture(self, visit: Visit) -> Response:
        """Return a picture of the run by its number; its file is named by the journal alone."""
        fold, params = self._live.fold, visit.request.path_params
        missing = refused(404, word("there is no such picture"))
        if fold is None or params["run"] != fold.run or params["number"] >= len(fold.pictures):
            return missing
        folder, name = self._setting.runs_dir / fold.run, fold.pictures[params["number"]]
        return await run_picture(folder, name) or missing

    async def choices(self, _: Visit) -> Response:
        """Return the recipes and cell files available for a run."""
        choices, last = await self._launcher.choices(), await self._launcher.last()
        again = None if last is None else last.model_dump(mode="json")
        return JsonAnswer({**asdict(choices), "last": again})

    async def list(self, _: Visit, sent: Uploaded) -> Response:
        """Keep a list of parts for a run; return its key and its content."""
        project = self._setting.project_dir.absolute()
        return JsonAnswer(await keep_sent(self._launcher, sent, project))

    async def cancel(self, _: Visit, __: CancelBody) -> Response:
        """End the preparation of the run that was started here; return whether that was done."""
        if not self._live.is_preparing:
            return refused(409, word("the run works already; stop it instead"))
        await self._launcher.cancel()
        return JsonAnswer({"done": True})

    async def start(self, visit: Visit, body: StartBody) -> Response:
        """Start a run in the name of a person; return that it was started, or why not."""
        await self._launcher.start(body, visit.account.name)
        self._live.publish()
        return JsonAnswer({"done": True})

    def _order(self, name: str, model: type[Order]) -> Callable[[Visit, Any], Awaitable[Response]]:
        async def answer(visit: Visit, body: _OrderBody) -> Response:
            order = model.model_validate({**body.model_dump(), "who": visit.who})
            try:
                async with self._acting:
                    reply = await asyncio.to_thread(self._cell.order, name, order)
            except (ControlError, OSError) as error:
                return refused(503, str(error))
            self._live.refresh()
            return JsonAnswer(facts(reply), 409 if reply.decision == "refused" else 200)

        return answer
