"""The screens of the page, and the application that serves them."""

from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any, Final

from starlette.applications import Starlette
from starlette.middleware import Middleware

from . import cell, history, now, recipes, review
from .frame.entering import Entrance
from .frame.routing import routes_of, upload_sizes
from .frame.screens import Screen, Setting
from .frame.visit import PageFrame
from .security import Guard

# In the order of the navigation bar.
SCREENS: Final[tuple[Callable[[Setting], Screen], ...]] = (
    now.screen,
    review.screen,
    history.screen,
    recipes.screen,
    cell.screen,
)


def build_screens(setting: Setting) -> tuple[Screen, ...]:
    """Return all screens in the order of the navigation bar."""
    return tuple(make(setting) for make in SCREENS)


class Page(Starlette):
    """The application, with the end of its long answers.

    Parameters
    ----------
    frame : frame shared by all screens
    more : further arguments of Starlette
    """

    def __init__(self, frame: PageFrame, **more: Any) -> None:  # noqa: ANN401 - Starlette's own
        super().__init__(**more)
        self._screens = frame.screens

    def hang_up(self) -> None:
        """End the answers that would go on for long."""
        for screen in self._screens:
            if screen.hang_up is not None:
                screen.hang_up()


def build_app(frame: PageFrame) -> Page:
    """Return the application; each screen's background task runs while it is served."""

    @asynccontextmanager
    async def beside(_: Starlette) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            for screen in frame.screens:
                if screen.beside is not None:
                    await stack.enter_async_context(screen.beside())
            yield

    guard = Middleware(Guard, site=frame.site, uploads=upload_sizes(frame.screens))
    routes = [*Entrance(frame).routes, *routes_of(frame)]
    return Page(frame, routes=routes, middleware=[guard], lifespan=beside)
