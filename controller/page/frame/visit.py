"""The frame round all screens, and a screen's data with each request."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Final

from jinja2 import ChoiceLoader, Environment, PackageLoader, PrefixLoader, StrictUndefined
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response

from messages.words import LANGUAGES, teller, words_in

from ..security import Account, Accounts, Attempts, BrowserSession, PageAddress, Role, Sessions
from .screens import Screen
from .words import (
    chosen,
    count_in,
    every_word,
    translator,
    value_in,
)

LANGUAGE_COOKIE: Final = "cellctl_language"
YEAR_S: Final = 31_536_000


class JsonAnswer(JSONResponse):
    """JSON whose sentences are put into words once the language of the person is known.

    Parameters
    ----------
    content : JSON object
    status : status of the answer
    """

    def __init__(self, content: Mapping[str, object], status: int = 200) -> None:
        self._content = content
        super().__init__(content, status)

    def in_language(self, language: str) -> Response:
        """Return the answer with the words of its texts beside them, by their English."""
        found = worded(self._content, language)
        return self if found is self._content else JSONResponse(found, self.status_code)


def worded(content: Mapping[str, object], language: str) -> Mapping[str, object]:
    """Return a JSON object with a member `words`: by the English of its texts those of a language.

    Parameters
    ----------
    content : JSON object
    language : one of `LANGUAGES`
    """
    found = words_in(language, content)
    return {**content, "words": found} if found else content


def refused(status: int, text: str) -> JsonAnswer:
    """Return a refusal, with a sentence on the reason."""
    return JsonAnswer({"error": text}, status)


def address_of(request: Request) -> str:
    """Return the address of the browser, by a reverse proxy's word where one is trusted."""
    return "" if request.client is None else request.client.host


@dataclass(frozen=True, eq=False)
class PageFrame:
    """Data shared by all screens.

    Attributes
    ----------
    site : addresses by which browsers find the page
    accounts, sessions, attempts : accounts, open sessions, and failed log-ins
    screens : in the order of the navigation bar
    one_at_a_time : lock held while a password is tried
    """

    site: PageAddress
    accounts: Accounts
    sessions: Sessions
    screens: tuple[Screen, ...]
    attempts: Attempts = field(default_factory=Attempts)
    one_at_a_time: asyncio.Lock = field(default_factory=asyncio.Lock)

    @cached_property
    def templates(self) -> Environment:
        """The templates: those shared by their names, a screen's and the shared below its name."""
        shared = PackageLoader("controller.page.frame")
        own = {
            one.name: ChoiceLoader([PackageLoader(f"controller.page.{one.name}"), shared])
            for one in self.screens
        }
        return Environment(
            loader=ChoiceLoader([PrefixLoader(own), shared]),
            autoescape=True,
            undefined=StrictUndefined,
        )

    def session(self, request: Request) -> BrowserSession | None:
        """Return the session of a request."""
        secret = request.cookies.get(self.site.cookie, "")
        return self.sessions.find(secret) if secret else None

    def html(
        self,
        request: Request,
        template: str,
        values: Mapping[str, object],
        *,
        screen: str = "frame",
        status: int = 200,
    ) -> Response:
        """Return HTML in the language of the person.

        Parameters
        ----------
        request : request to answer
        template : its name
        values : values for the template, by name
        screen : screen with its texts
        status : status of the answer
        """
        language = language_of(request)
        text = self.templates.get_template(template).render(
            _=translator(language, screen), language=language, languages=LANGUAGES, **values
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


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """A request of a logged-in user with the right to it.

    Attributes
    ----------
    frame, screen : frame and screen visited
    request : request of the browser; the body of an act or an upload has been read
    session : session of the user
    """

    frame: PageFrame
    screen: Screen
    request: Request
    session: BrowserSession

    @property
    def account(self) -> Account:
        """The user."""
        return self.session.account

    @property
    def who(self) -> str:
        """The user, as named in the journal."""
        return f"{self.account.name}, page"

    @property
    def language(self) -> str:
        """The language of the person."""
        return language_of(self.request)

    def is_logged_in(self) -> bool:
        """Return whether the session still lasts; for answers that go on for long."""
        return self.frame.session(self.request) is not None

    def html(self, template: str, status: int = 200, /, **values: object) -> Response:
        """Return a page of the screen; the template extends `screen.html.j2`.

        Parameters
        ----------
        template : its name within the screen's `templates/`, or the shared ones
        status : status of the answer
        values : values for the template, beside `who`, `role`, `may_act`, `may_edit` and those of
            the frame
        """
        role, told = self.account.role, teller(self.language)
        shared: dict[str, object] = {
            "screen": self.screen.name,
            "screens": [one for one in self.frame.screens if role >= one.role],
            "path": self.request.url.path,
            "who": self.account.name,
            "role": role.word,
            "may_act": role >= Role.OPERATOR,
            "may_edit": role >= Role.ENGINEER,
            "csrf": self.session.csrf,
            "words": dict(every_word(self.language, self.screen.name)),
            "told": told,
            "told_all": lambda texts: ", ".join(map(told, texts)),
            "value": partial(value_in, self.language),
            "count": partial(count_in, self.language),
        }
        name = self.screen.name
        return self.frame.html(
            self.request, f"{name}/{template}", shared | values, screen=name, status=status
        )


def language_of(request: Request) -> str:
    """Return the language of a request."""
    wanted = request.query_params.get("lang") or request.cookies.get(LANGUAGE_COOKIE)
    return chosen(wanted, request.headers.get("accept-language", ""))
