"""The limits of a server that strangers can reach: uvicorn with a patient protocol."""

import asyncio
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol

from .security.guard import HEADER_MAX_BYTES

HEADER_WALL_S: Final = 10.0
CONNECTION_MAX_COUNT: Final = 200
# A browser opens 6 to a host: six browsers of one address, and no address has more than a fifth.
CONNECTION_OF_ONE_MAX_COUNT: Final = 40
KEEP_ALIVE_WALL_S: Final = 15
END_WALL_S: Final = 2


@dataclass(frozen=True, slots=True)
class Serving:
    """Options of the server.

    Attributes
    ----------
    host, port : address of the server
    cert, key : files of the certificate and its key, None for plain HTTP
    proxies : addresses of reverse proxies whose word on the browser's address counts
    """

    host: str
    port: int
    cert: Path | None = None
    key: Path | None = None
    proxies: tuple[str, ...] = ()


class PatientProtocol(H11Protocol):
    """uvicorn's protocol with a time limit for the header of a request.

    With too many connections, of one address or in all, the one that has been idle for longest is
    closed as well; without an idle one, the new one is.
    """

    _waiting: asyncio.TimerHandle | None = None
    idle_since_s = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first header."""
        super().connection_made(transport)
        self.idle_since_s = self.loop.time()
        self._wait()
        self._make_room()

    def data_received(self, data: bytes) -> None:
        """Take the bytes that have arrived; wait for the rest of a header."""
        super().data_received(data)
        if self.is_idle:
            if self._waiting is None:
                self._wait()
        else:
            self._wait_no_more()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._wait_no_more()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Be idle from now on."""
        self.idle_since_s = self.loop.time()
        super().on_response_complete()

    @property
    def is_idle(self) -> bool:
        """No request is complete as far as its header, or it is answered."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def address(self) -> str:
        """Address of the other end; empty for a reverse proxy, which has the browsers of many."""
        address = "" if self.client is None else self.client[0]
        is_proxy = self.config.proxy_headers and address in (self.config.forwarded_allow_ips or ())
        return "" if is_proxy else address

    def _make_room(self) -> None:
        every = [
            one
            for one in self.connections
            if isinstance(one, PatientProtocol) and not one.transport.is_closing()
        ]
        own = [one for one in every if self.address and one.address == self.address]
        for group, most in (
            (own, CONNECTION_OF_ONE_MAX_COUNT),
            (every, CONNECTION_MAX_COUNT),
        ):
            if len(group) > most:
                idle = (one for one in group if one.is_idle)
                min(idle, key=lambda one: one.idle_since_s).transport.abort()
                return

    def _wait(self) -> None:
        self._waiting = self.loop.call_later(HEADER_WALL_S, self._give_up)

    def _wait_no_more(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _give_up(self) -> None:
        self._waiting = None
        self.transport.abort()


def config_of(app: Starlette, serving: Serving) -> uvicorn.Config:
    """Return uvicorn's configuration, with the limits of a server that strangers can reach.

    Parameters
    ----------
    app : what it serves
    serving : address of the server, and its certificate

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
    return uvicorn.Config(
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
        limit_concurrency=CONNECTION_MAX_COUNT + 1,  # uvicorn refuses from this count on
        h11_max_incomplete_event_size=HEADER_MAX_BYTES,
        timeout_keep_alive=KEEP_ALIVE_WALL_S,
        timeout_graceful_shutdown=END_WALL_S,
        **options,
    )
