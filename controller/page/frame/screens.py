"""Parts of a screen of the page: its place, its users, its answers.

A screen lists looks, acts and uploads. Their routes are made by `routing.py`, which puts the checks
of session, role, token and body before each, so that none can be left out.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict

from ..security import Role

if TYPE_CHECKING:
    from starlette.responses import Response

    from .uploads import Uploaded
    from .visit import Visit


@dataclass(frozen=True, slots=True)
class Setting:
    """Start options of the page.

    Attributes
    ----------
    runs_dir : folder of all runs
    project_dir : folder of recipes and cell files
    """

    runs_dir: Path
    project_dir: Path


class RequestRefusedError(Exception):
    """The request is refused; the text is the answer.

    Attributes
    ----------
    status : status of the answer
    """

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


class PostBody(BaseModel):
    """The body of an act, as the browser sends it."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class NoBody(PostBody):
    """An act that needs no words."""


@dataclass(frozen=True, slots=True)
class GetRoute:
    """An answer to GET; it changes nothing.

    Attributes
    ----------
    path : below the screen, as Starlette writes it (`picture/{number:int}`); empty is the screen
    answer : function that makes the answer
    role : the least role that may see it
    """

    path: str
    answer: Callable[[Visit], Awaitable[Response]]
    role: Role = Role.VIEWER


@dataclass(frozen=True, slots=True)
class PostRoute:
    """An order by POST: a small JSON body, with the token of the session.

    Attributes
    ----------
    path : below the screen
    body : model that the body must fit
    answer : function that does the work
    role : the least role that may do it
    """

    path: str
    body: type[PostBody]
    answer: Callable[[Visit, Any], Awaitable[Response]]
    role: Role


@dataclass(frozen=True, slots=True)
class Upload:
    """An upload by POST: its bytes alone are the body, its name is in the query.

    Attributes
    ----------
    path : below the screen, without parameters
    max_bytes : largest size
    suffixes : allowed endings of its name, in lower case
    answer : function that uses it; the file is deleted once the answer is made
    role : the least role that may do it
    """

    path: str
    max_bytes: int
    suffixes: frozenset[str]
    answer: Callable[[Visit, Uploaded], Awaitable[Response]]
    role: Role


@dataclass(frozen=True, slots=True)
class Screen:
    """A screen of the page.

    Attributes
    ----------
    name : in small letters: the first part of its addresses, and its package below
        `controller.page`, with `templates/`, `static/` and `catalogues/`
    title : in English, for the navigation bar; the catalogue of `frame` has it
    answers : paths and methods it answers
    role : the least role to which the navigation bar shows it
    beside : background task while the page is served; None for none
    hang_up : ends the answers that would go on for long, None where there are none; called when the
        page ends, before it waits for its answers
    """

    name: str
    title: str
    answers: tuple[GetRoute | PostRoute | Upload, ...]
    role: Role = Role.VIEWER
    beside: Callable[[], AbstractAsyncContextManager[None]] | None = None
    hang_up: Callable[[], None] | None = None

    def address(self, path: str) -> str:
        """Return the address of something below the screen."""
        return f"/{self.name}/{path}" if path else f"/{self.name}"
