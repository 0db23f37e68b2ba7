"""The server's process: uvicorn with the page's limits."""

import asyncio
import gc
import logging
import socket
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import uvicorn

from controller.memory import map_large_arrays

from .app import Page, build_app, build_screens
from .frame.screens import Setting
from .frame.visit import PageFrame
from .http import Serving, config_of
from .security import Accounts, PageAddress, Sessions


class Server(uvicorn.Server):
    """uvicorn's server; it ends long answers before it waits for the rest.

    Parameters
    ----------
    app : the page
    config : with the page in it
    ready : called once it listens
    """

    def __init__(self, app: Page, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._app = app
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen, then report it: before that a browser would be refused."""
        await super().startup(sockets)
        if self.started:
            self._ready()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End the page; a second signal does not wait for answers.

        uvicorn's own method lets the process die of the signal in the end, which would leave behind
        the shared resources of child processes.
        """
        self.force_exit = self.should_exit
        self.should_exit = True

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams, then everything."""
        self._app.hang_up()
        # a browser that reads nothing is left after `END_WALL_S`, which is no error of the page
        log = logging.getLogger("uvicorn.error")
        log.addFilter(_is_no_cancelling)
        try:
            await super().shutdown(sockets)
        finally:
            log.removeFilter(_is_no_cancelling)


def _is_no_cancelling(record: logging.LogRecord) -> bool:
    found = record.exc_info
    return not (found and isinstance(found[1], asyncio.CancelledError))


def build(
    runs_dir: Path, project_dir: Path, site: PageAddress, accounts: Accounts, sessions: Sessions
) -> Page:
    """Return the whole page of a folder of runs, with its background tasks.

    Parameters
    ----------
    runs_dir : folder of all runs
    project_dir : folder of recipes and cell files
    site : addresses by which browsers find it
    accounts, sessions : accounts and open sessions
    """
    screens = build_screens(Setting(runs_dir, project_dir))
    return build_app(PageFrame(site, accounts, sessions, screens))


def serve(app: Page, serving: Serving, ready: Callable[[], None]) -> None:
    """Serve the page until a signal ends it.

    Parameters
    ----------
    app, serving : the page, and how it is served
    ready : called once it listens

    Raises
    ------
    OSError : certificate or key cannot be read
    """
    map_large_arrays()
    server_of(app, serving, ready).run()
    # the process ends now: nothing is gained by looking through all its objects once more, which
    # takes seconds on a busy machine
    gc.freeze()


def server_of(app: Page, serving: Serving, ready: Callable[[], None] = lambda: None) -> Server:
    """Return the server, with its limits.

    Parameters
    ----------
    app : the page
    serving : address of the server, and its certificate
    ready : called once it listens

    Raises
    ------
    OSError : certificate or key cannot be read
    """
    return Server(app, config_of(app, serving), ready)
