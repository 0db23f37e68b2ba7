"""The server's process: uvicorn with the page's limits."""

import asyncio
import gc
import logging
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from .app import Page, build_app, build_screens
from .frame.screens import Setting
from .frame.visit import Frame
from .security import Accounts, Sessions, Site
from .security.guard import HEADER_MAX_BYTES

HEADER_WALL_S: Final = 10.0
CONNECTION_MAX_COUNT: Final = 200
KEEP_ALIVE_WALL_S: Final = 15
END_WALL_S: Final = 2


@dataclass(frozen=True, slots=True)
class Serving:
    """How the page is served.

    Attributes
    ----------
    host, port : where it listens
    cert, key : files of the certificate and its key, None for plain HTTP
    proxies : addresses of reverse proxies whose word on the browser's address counts
    """

    host: str
    port: int
    cert: Path | None = None
    key: Path | None = None
    proxies: tuple[str, ...] = ()


class PatientProtocol(H11Protocol):
    """uvicorn's protocol, but a request whose header does not arrive in time is given up."""

    _waiting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first header."""
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Take what has arrived; wait for the rest of a header."""
        super().data_received(data)
        if self.cycle is None or self.cycle.response_complete:
            if self._waiting is None:
                self._wait()
        else:
            self._wait_no_more()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._wait_no_more()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._waiting = self.loop.call_later(HEADER_WALL_S, self._give_up)

    def _wait_no_more(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _give_up(self) -> None:
        self._waiting = None
        self.transport.abort()


class Server(uvicorn.Server):
    """uvicorn's server, but what would go on for long is ended before it waits for the rest.

    Parameters
    ----------
    app : the page
    config : with the page in it
    """

    def __init__(self, app: Page, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._app = app

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End the page; a second signal does not wait for answers.

        uvicorn's own method has the process die of the signal in the end, and what child processes
        share is then left behind.
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
    runs_dir: Path, project_dir: Path, site: Site, accounts: Accounts, sessions: Sessions
) -> Page:
    """Return the whole page of a folder of runs, with what runs beside it.

    Parameters
    ----------
    runs_dir : folder of all runs
    project_dir : folder of recipes and cell files
    site : under which addresses browsers find it
    accounts, sessions : who may log in, and who has
    """
    screens = build_screens(Setting(runs_dir, project_dir))
    return build_app(Frame(site, accounts, sessions, screens))


def serve(app: Page, serving: Serving) -> None:
    """Serve the page until a signal ends it.

    Raises
    ------
    OSError : certificate or key cannot be read
    """
    server_of(app, serving).run()
    # the process ends now: nothing is gained by looking through all its objects once more, which
    # takes seconds on a busy machine
    gc.freeze()


def server_of(app: Page, serving: Serving) -> Server:
    """Return the server, with its limits.

    Raises
    ------
    OSError : certificate or key cannot be read
    """
    options: dict[str, Any] = {}
    if serving.cert is not None and serving.key is not None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.load_cert_chain(serving.cert, serving.key)  # fails here, with the reason
        options = {"ssl_certfile": str(serving.cert), "ssl_keyfile": str(serving.key)}
    config = uvicorn.Config(
        app,
        host=serving.host,
        port=serving.port,
        http=PatientProtocol,
        ws="none",
        log_config=None,
        access_log=False,
        server_header=False,
        date_header=True,
        proxy_headers=bool(serving.proxies),
        forwarded_allow_ips=list(serving.proxies) or None,
        limit_concurrency=CONNECTION_MAX_COUNT,
        h11_max_incomplete_event_size=HEADER_MAX_BYTES,
        timeout_keep_alive=KEEP_ALIVE_WALL_S,
        timeout_graceful_shutdown=END_WALL_S,
        **options,
    )
    return Server(app, config)
