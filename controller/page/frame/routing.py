"""Makes routes of the screens' answers, each behind the checks of its kind."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Final

from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from controller.launching import LaunchRefusedError

from ..security import Role
from ..security.sessions import same
from .screens import GetRoute, PostRoute, RequestRefusedError, Screen, Upload
from .uploads import received
from .visit import JsonAnswer, PageFrame, Visit, language_of, refused
from .words import word

Endpoint = Callable[[Request], Awaitable[Response]]

NOBODY: Final = word("nobody is logged in")
FORGED: Final = word("the order is not of this page")
NEEDED: Final[Mapping[Role, str]] = {
    Role.VIEWER: word("only who is logged in may do this"),
    Role.OPERATOR: word("only an operator may do this"),
    Role.ENGINEER: word("only an engineer may do this"),
}
UPLOADS_AT_ONCE: Final = 2


def routes_of(frame: PageFrame) -> list[Route]:
    """Return the routes of all screens.

    Raises
    ------
    ValueError : two answers of a screen have one path
    """
    uploading = asyncio.Semaphore(UPLOADS_AT_ONCE)
    found: list[Route] = []
    for screen in frame.screens:
        taken: set[tuple[str, bool]] = set()
        for one in screen.answers:
            key = (one.path, isinstance(one, GetRoute))
            if key in taken:
                raise ValueError(f"{screen.name}: `{one.path}` is answered twice")
            taken.add(key)
            address = screen.address(one.path)
            match one:
                case GetRoute():
                    endpoint, method = _looked(frame, screen, one), "GET"
                case PostRoute():
                    endpoint, method = _acted(frame, screen, one), "POST"
                case Upload():
                    endpoint, method = _uploaded(frame, screen, one, uploading), "POST"
            found.append(Route(address, _refusing(endpoint), methods=[method]))
    return found


def upload_sizes(screens: tuple[Screen, ...]) -> Mapping[str, int]:
    """Return the largest body of each address that takes a file [bytes]."""
    return {
        screen.address(one.path): one.max_bytes
        for screen in screens
        for one in screen.answers
        if isinstance(one, Upload)
    }


def is_own(request: Request, csrf: str) -> bool:
    """Return whether a request carries the token of its session."""
    return same(request.headers.get("x-csrf-token", ""), csrf)


def _entered(
    frame: PageFrame, screen: Screen, one: GetRoute | PostRoute | Upload, request: Request
) -> Visit | Response:
    """Return the visit of a request, or the reason why it is refused."""
    session = frame.session(request)
    if session is None:
        wants_page = one.path == "" or "text/html" in request.headers.get("accept", "")
        if isinstance(one, GetRoute) and wants_page:
            return RedirectResponse("/login", 303)
        return refused(401, NOBODY)
    if not isinstance(one, GetRoute) and not is_own(request, session.csrf):
        return refused(403, FORGED)
    if session.account.role < one.role:
        return refused(403, NEEDED[one.role])
    return Visit(frame, screen, request, session)


def _looked(frame: PageFrame, screen: Screen, one: GetRoute) -> Endpoint:
    async def endpoint(request: Request) -> Response:
        visit = _entered(frame, screen, one, request)
        return await one.answer(visit) if isinstance(visit, Visit) else visit

    return endpoint


def _acted(frame: PageFrame, screen: Screen, one: PostRoute) -> Endpoint:
    async def endpoint(request: Request) -> Response:
        visit = _entered(frame, screen, one, request)
        if not isinstance(visit, Visit):
            return visit
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return refused(415, word("an order is JSON"))
        try:
            body = one.body.model_validate_json(await request.body() or b"{}")
        except ValidationError:
            return refused(422, word("the order makes no sense"))
        return await one.answer(visit, body)

    return endpoint


def _uploaded(
    frame: PageFrame, screen: Screen, one: Upload, uploading: asyncio.Semaphore
) -> Endpoint:
    async def endpoint(request: Request) -> Response:
        visit = _entered(frame, screen, one, request)
        if not isinstance(visit, Visit):
            return visit
        if uploading.locked():
            return refused(503, word("other files are being sent; try again soon"))
        async with uploading, received(request, one) as file:
            return await one.answer(visit, file)

    return endpoint


def _refusing(answer: Endpoint) -> Endpoint:
    async def endpoint(request: Request) -> Response:
        try:
            found = await answer(request)
        except (RequestRefusedError, LaunchRefusedError) as error:
            found = refused(error.status, str(error))
        return found.in_language(language_of(request)) if isinstance(found, JsonAnswer) else found

    return endpoint
