"""What the page answers: HTML, the stream of changes, pictures, and orders to the cell."""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs

from jinja2 import Environment, PackageLoader, StrictUndefined
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    RedirectResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from controller.cell.control import (
    MAX_KEY,
    MAX_WHO,
    AnswerOrder,
    ControlError,
    Order,
    PauseOrder,
    ResumeOrder,
    RunningCell,
    facts,
)

from .files import mesh_of, packed_json, picture_bytes, static_files
from .live import Live, TooManyWatchersError
from .security import (
    Account,
    Accounts,
    AccountsError,
    Attempts,
    Guard,
    Role,
    Session,
    Sessions,
    Site,
)
from .security.sessions import same
from .words import LANGUAGES, chosen, every_word, translator

LANGUAGE_COOKIE: Final = "cellctl_language"
YEAR_S: Final = 31_536_000
FIRST_MAX: Final = 1000


class _Body(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    why: str = Field(default="", max_length=MAX_WHO)


class PauseBody(_Body):
    """A pause, as the browser orders it."""

    kind: str = Field(pattern="^(step|safe|now)$")


class ResumeBody(_Body):
    """A resume, with the first motion that the person was shown."""

    first: str | None = Field(max_length=FIRST_MAX)


class StopBody(_Body):
    """A stop."""


class AnswerBody(_Body):
    """An answer to the question that the person has read."""

    key: str = Field(min_length=1, max_length=MAX_KEY)
    number: int = Field(ge=1)


@dataclass(frozen=True, eq=False)
class Page:
    """The page of one folder of runs.

    Attributes
    ----------
    runs_dir : folder of all runs
    site : under which addresses browsers find it
    accounts, sessions, attempts : who may log in, who has, who tried
    live : what is known of the cell
    """

    runs_dir: Path
    site: Site
    accounts: Accounts
    sessions: Sessions
    live: Live
    attempts: Attempts = field(default_factory=Attempts)
    one_at_a_time: asyncio.Lock = field(default_factory=asyncio.Lock)
    templates: Environment = field(
        default_factory=lambda: Environment(
            loader=PackageLoader("controller.page", "templates"),
            autoescape=True,
            undefined=StrictUndefined,
        )
    )

    def session(self, request: Request) -> Session | None:
        """Return the session of a request."""
        secret = request.cookies.get(self.site.cookie, "")
        return self.sessions.find(secret) if secret else None

    def html(
        self, request: Request, template: str, status: int = 200, **values: object
    ) -> Response:
        """Return a page of HTML in the language of the person.

        Parameters
        ----------
        request : what is answered
        template : name of the page's frame
        status : of the answer
        values : what the frame shows
        """
        language = language_of(request)
        text = self.templates.get_template(template).render(
            _=translator(language), language=language, languages=LANGUAGES, **values
        )
        response = HTMLResponse(text, status)
        if request.query_params.get("lang") in LANGUAGES:
            response.set_cookie(
                LANGUAGE_COOKIE,
                language,
                max_age=YEAR_S,
                samesite="strict",
                secure=self.site.is_secure,
                httponly=True,
            )
        return response

    def entered(self, account: Account) -> Response:
        """Return the way to the page for somebody who has just logged in."""
        response = RedirectResponse("/now", HTTPStatus.SEE_OTHER)
        response.set_cookie(
            self.site.cookie,
            self.sessions.begin(account),
            path="/",
            samesite="strict",
            secure=self.site.is_secure,
            httponly=True,
        )
        return response


def language_of(request: Request) -> str:
    """Return the language of a request."""
    wanted = request.query_params.get("lang") or request.cookies.get(LANGUAGE_COOKIE)
    return chosen(wanted, request.headers.get("accept-language", ""))


def build_app(
    page: Page, beside: Callable[[Starlette], AbstractAsyncContextManager[None]] | None = None
) -> Starlette:
    """Return the application.

    Parameters
    ----------
    page : what it shows, and to whom
    beside : what runs while it serves
    """
    views = _Views(page)
    routes = [
        Route("/", views.root),
        Route("/login", views.login_form, methods=["GET"]),
        Route("/login", views.login, methods=["POST"]),
        Route("/enter", views.enter),
        Route("/logout", views.logout, methods=["POST"]),
        Route("/now", views.now),
        Route("/session", views.who),
        Route("/events", views.events),
        Route("/scene", views.scene),
        Route("/mesh", views.mesh),
        Route("/picture/{run:str}/{number:int}", views.picture),
        Route("/act/{name:str}", views.act, methods=["POST"]),
        Route("/static/{name:path}", views.static),
    ]
    return Starlette(routes=routes, middleware=[Middleware(Guard, site=page.site)], lifespan=beside)


def _error(status: int, text: str) -> JSONResponse:
    return JSONResponse({"error": text}, status)


class _Views:
    def __init__(self, page: Page) -> None:
        self._page = page
        self._cell = RunningCell(page.runs_dir)
        self._static = static_files()
        self._mesh: tuple[str, bytes] | None = None
        self._acting = asyncio.Lock()

    async def root(self, request: Request) -> Response:
        """Lead to the page, or to the log-in."""
        return RedirectResponse("/now" if self._page.session(request) else "/login", 303)

    async def login_form(self, request: Request) -> Response:
        """Show the log-in."""
        return self._page.html(request, "login.html.j2", error="", name="")

    async def login(self, request: Request) -> Response:
        """Log somebody in, or say no; slow on purpose, and one at a time."""
        page = self._page
        try:
            form = parse_qs((await request.body()).decode(), max_num_fields=4, errors="strict")
        except (UnicodeDecodeError, ValueError):
            return _error(400, "this is no log-in")
        name, password = form.get("name", [""])[0][:80], form.get("password", [""])[0]
        address = "" if request.client is None else request.client.host
        if page.attempts.seconds_to_wait(address) > 0:
            text = "Too many attempts. Try again in some minutes."
            return page.html(request, "login.html.j2", 429, error=text, name=name)
        page.attempts.note(address)
        try:
            async with page.one_at_a_time:
                account = await asyncio.to_thread(page.accounts.find, name, password)
        except AccountsError as error:
            return page.html(request, "login.html.j2", 503, error=str(error), name=name)
        if account is None:
            text = "Name or password is wrong."
            return page.html(request, "login.html.j2", 403, error=text, name=name)
        page.attempts.forgive(address)
        return page.entered(account)

    async def enter(self, request: Request) -> Response:
        """Log in by the link that was printed; it is spent by that."""
        page = self._page
        account = page.sessions.redeem(request.query_params.get("token", ""))
        if account is None:
            if page.session(request) is not None:  # the same link once more, in the same browser
                return RedirectResponse("/now", 303)
            text = "This link was used, or is too old."
            return page.html(request, "login.html.j2", 403, error=text, name="")
        return page.entered(account)

    async def logout(self, request: Request) -> Response:
        """End the session."""
        page, session = self._page, self._page.session(request)
        if session is None:
            return RedirectResponse("/login", 303)
        if not self._is_own(request, session):
            return _error(403, "the order is not of this page")
        page.sessions.end(request.cookies.get(page.site.cookie, ""))
        response = JSONResponse({"done": True})
        response.delete_cookie(
            page.site.cookie, path="/", samesite="strict", secure=page.site.is_secure
        )
        return response

    async def now(self, request: Request) -> Response:
        """Show what the cell does now."""
        session = self._page.session(request)
        if session is None:
            return RedirectResponse("/login", 303)
        language = language_of(request)
        return self._page.html(
            request,
            "now.html.j2",
            who=session.account.name,
            role=session.account.role.word,
            may_act=session.account.role >= Role.OPERATOR,
            csrf=session.csrf,
            words=dict(every_word(language)),
        )

    async def who(self, request: Request) -> Response:
        """Return who is logged in."""
        session = self._page.session(request)
        if session is None:
            return _error(401, "nobody is logged in")
        account = session.account
        return JSONResponse({"name": account.name, "role": account.role.word})

    async def events(self, request: Request) -> Response:
        """Stream what is known, then each change, for as long as the session lasts."""
        if self._page.session(request) is None:
            return _error(401, "nobody is logged in")
        stream = self._page.live.watch()
        try:
            first = await anext(stream)
        except TooManyWatchersError:
            return _error(503, "too many browsers look already")

        async def lines() -> Any:  # noqa: ANN401  (an asynchronous generator of str)
            yield f"retry: 1000\nevent: {first[0]}\ndata: {first[1]}\n\n"
            async for kind, message in stream:
                if self._page.session(request) is None:
                    yield "event: end\ndata: {}\n\n"
                    return
                yield f"event: {kind}\ndata: {message}\n\n"

        return StreamingResponse(
            lines(), media_type="text/event-stream", headers={"X-Accel-Buffering": "no"}
        )

    async def scene(self, request: Request) -> Response:
        """Return what stands in the cell."""
        if self._page.session(request) is None:
            return _error(401, "nobody is logged in")
        scene = self._page.live.scene
        if scene is None:
            return _error(404, "there is no cell to draw")
        return _packed(packed_json(scene.standing))

    async def mesh(self, request: Request) -> Response:
        """Return the part's mesh."""
        if self._page.session(request) is None:
            return _error(401, "nobody is logged in")
        fold = self._page.live.fold
        if fold is None:
            return _error(404, "there is no run")
        if self._mesh is None or self._mesh[0] != fold.run:
            folder = self._page.runs_dir / fold.run
            found = await asyncio.to_thread(lambda: packed_json(mesh_of(fold, folder)))
            self._mesh = (fold.run, found)
        return _packed(self._mesh[1])

    async def picture(self, request: Request) -> Response:
        """Return a picture of the run by its number; its file is named by the journal alone."""
        if self._page.session(request) is None:
            return _error(401, "nobody is logged in")
        fold = self._page.live.fold
        run, number = request.path_params["run"], request.path_params["number"]
        if fold is None or run != fold.run or number >= len(fold.pictures):
            return _error(404, "there is no such picture")
        folder = (self._page.runs_dir / fold.run).resolve()
        path = (folder / fold.pictures[number]).resolve()
        if not path.is_relative_to(folder):
            return _error(404, "there is no such picture")
        found = await asyncio.to_thread(picture_bytes, path)
        if found is None:
            return _error(404, "there is no such picture")
        headers = {"Cache-Control": "private, max-age=86400, immutable"}
        return Response(found, media_type="image/jpeg", headers=headers)

    async def act(self, request: Request) -> Response:
        """Give the cell an order in the name of a person; the cell decides, and journals it."""
        session = self._page.session(request)
        if session is None:
            return _error(401, "nobody is logged in")
        if not self._is_own(request, session):
            return _error(403, "the order is not of this page")
        if session.account.role < Role.OPERATOR:
            return _error(403, "only an operator may act on the cell")
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return _error(415, "an order is JSON")
        name = request.path_params["name"]
        try:
            order = _order(name, await request.body(), f"{session.account.name}, page")
        except KeyError:
            return _error(404, "there is no such order")
        except ValidationError:
            return _error(422, "the order makes no sense")
        try:
            async with self._acting:
                reply = await asyncio.to_thread(self._cell.order, name, order)
        except (ControlError, OSError) as error:
            return _error(503, str(error))
        self._page.live.refresh()
        return JSONResponse(facts(reply), 409 if reply.decision == "refused" else 200)

    async def static(self, request: Request) -> Response:
        """Return a file of the page itself."""
        found = self._static.get(request.path_params["name"])
        if found is None:
            return _error(404, "there is no such file")
        headers = {"ETag": found.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        if request.headers.get("if-none-match") == found.tag:
            return Response(status_code=304, headers=headers)
        if "gzip" in request.headers.get("accept-encoding", ""):
            headers["Content-Encoding"] = "gzip"
            return Response(found.packed, media_type=found.kind, headers=headers)
        return Response(found.content, media_type=found.kind, headers=headers)

    def _is_own(self, request: Request, session: Session) -> bool:
        return same(request.headers.get("x-csrf-token", ""), session.csrf)


def _packed(content: bytes) -> Response:
    return Response(content, media_type="application/json", headers={"Content-Encoding": "gzip"})


def _order(name: str, body: bytes, who: str) -> Order:
    """Return the order that a body stands for.

    Raises
    ------
    KeyError : there is no order of that name
    ValidationError : the body makes no sense
    """
    model = BODIES[name]
    found = model.model_validate_json(body or b"{}")
    return ORDERS[name].model_validate({**found.model_dump(), "who": who})


BODIES: Final[Mapping[str, type[_Body]]] = {
    "pause": PauseBody,
    "resume": ResumeBody,
    "stop": StopBody,
    "answer": AnswerBody,
}
ORDERS: Final[Mapping[str, type[Order]]] = {
    "pause": PauseOrder,
    "resume": ResumeOrder,
    "stop": Order,
    "answer": AnswerOrder,
}
