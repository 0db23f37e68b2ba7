"""Answers without a session: log-in, the printed link, log-out, the page's own files."""

import asyncio
from http import HTTPStatus
from urllib.parse import parse_qs

from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from ..security import Account, AccountsError, Role
from .files import static_files
from .routing import FORGED, NOBODY, is_own
from .visit import PageFrame, address_of, refused
from .words import word

HOME = "/now"


class Entrance:
    """The way in and out.

    Parameters
    ----------
    frame : frame of the target page
    """

    def __init__(self, frame: PageFrame) -> None:
        self._frame = frame
        self._static = static_files(one.name for one in frame.screens)

    @property
    def routes(self) -> list[Route]:
        """All answers without a session."""
        return [
            Route("/", self.root),
            Route("/login", self.login_form, methods=["GET"]),
            Route("/login", self.login, methods=["POST"]),
            Route("/enter", self.enter),
            Route("/logout", self.logout, methods=["POST"]),
            Route("/session", self.who),
            Route("/static/{name:path}", self.static),
        ]

    async def root(self, request: Request) -> Response:
        """Return the way to the first screen, or to the log-in."""
        return RedirectResponse(HOME if self._frame.session(request) else "/login", 303)

    async def login_form(self, request: Request) -> Response:
        """Return the log-in."""
        return self._form(request, "", "", 200)

    async def login(self, request: Request) -> Response:
        """Log somebody in, or refuse; slow on purpose, one at a time. Return the redirect."""
        frame = self._frame
        try:
            form = parse_qs((await request.body()).decode(), max_num_fields=4, errors="strict")
        except (UnicodeDecodeError, ValueError):
            return refused(400, word("this is no log-in"))
        name, password = form.get("name", [""])[0][:80], form.get("password", [""])[0]
        address = address_of(request)
        if frame.attempts.seconds_to_wait(address) > 0:
            text = word("Too many attempts. Try again in some minutes.")
            return self._form(request, text, name, 429)
        frame.attempts.note(address)
        try:
            async with frame.one_at_a_time:
                account = await asyncio.to_thread(frame.accounts.find, name, password)
        except AccountsError as error:
            return self._form(request, str(error), name, 503)
        if account is None or account.role is Role.PLANT:
            return self._form(request, word("Name or password is wrong."), name, 403)
        frame.attempts.forgive(address)
        return self._entered(request, account)

    async def enter(self, request: Request) -> Response:
        """Log in by the printed link, which is spent by that. Return the way on."""
        account = self._frame.sessions.redeem(request.query_params.get("token", ""))
        if account is None:
            if self._frame.session(request) is not None:  # the same link, in the same browser
                return RedirectResponse(HOME, 303)
            return self._form(request, word("This link was used, or is too old."), "", 403)
        return self._entered(request, account)

    async def logout(self, request: Request) -> Response:
        """End the session; return that it has ended."""
        frame, session = self._frame, self._frame.session(request)
        if session is None:
            return RedirectResponse("/login", 303)
        if not is_own(request, session.csrf):
            return refused(403, FORGED)
        frame.sessions.end(request.cookies.get(frame.site.cookie, ""))
        response = JSONResponse({"done": True})
        response.delete_cookie(
            frame.site.cookie, path="/", samesite="strict", secure=frame.site.is_secure
        )
        return response

    async def who(self, request: Request) -> Response:
        """Return the user who is logged in."""
        session = self._frame.session(request)
        if session is None:
            return refused(401, NOBODY)
        account = session.account
        return JSONResponse({"name": account.name, "role": account.role.word})

    async def static(self, request: Request) -> Response:
        """Return a file of the page itself."""
        found = self._static.get(request.path_params["name"])
        if found is None:
            return refused(404, word("there is no such file"))
        headers = {"ETag": found.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        if request.headers.get("if-none-match") == found.tag:
            return Response(status_code=304, headers=headers)
        if "gzip" in request.headers.get("accept-encoding", ""):
            headers["Content-Encoding"] = "gzip"
            return Response(found.packed, media_type=found.kind, headers=headers)
        return Response(found.content, media_type=found.kind, headers=headers)

    def _form(self, request: Request, error: str, name: str, status: int) -> Response:
        values = {"error": error, "name": name}
        return self._frame.html(request, "login.html.j2", values, status=status)

    def _entered(self, request: Request, account: Account) -> Response:
        """Return the redirect to the page for a user who has just logged in."""
        frame = self._frame
        # a cookie that was there before is worth nothing afterwards
        frame.sessions.end(request.cookies.get(frame.site.cookie, ""))
        response = RedirectResponse(HOME, HTTPStatus.SEE_OTHER)
        response.set_cookie(
            frame.site.cookie,
            frame.sessions.begin(account),
            path="/",
            samesite="strict",
            secure=frame.site.is_secure,
            httponly=True,
        )
        return response
