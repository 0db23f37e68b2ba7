"""Serves the control socket: HTTP/1.1 over a unix socket, framed by h11. Knows no cell.

One request a connection, bounded in size and in time. Only processes of the same user are served,
and errors go out as a sentence only. Idle connections keep nobody out: a new one takes the place of
an idle one, and requests that read leave the places of orders free.
"""

import asyncio
import logging
import os
import socket
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h11

from controller.cell.devices.supervision import CallerPrograms
from messages import key, say

from ..peer import Peer, peer_of
from ..place import ControlError
from ..words import ErrorReply, reply_bytes

log = logging.getLogger(__name__)

MAX_HEADER_BYTES: Final = 8_192
MAX_BODY_BYTES: Final = 16_384
# Largest number of idle connections, of requests that read (GET) and of orders, each: enough for a
# few terminals, the page and a program of the plant.
MAX_CONNECTION_COUNT: Final = 16
# For the whole of a request to arrive, and for its answer to leave. Real seconds: the other end is
# a person's program, no device.
IO_LIMIT_WALL_S: Final = 5.0
CHUNK_BYTES: Final = 4_096

Answer = tuple[int, bytes]
Handle = Callable[[Peer, str, str, bytes], Awaitable[Answer]]


@dataclass(frozen=True, slots=True)
class _Request:
    method: str
    path: str
    body: bytes


class _BadRequestError(Exception):
    """A malformed request: its HTTP status, and the reason; without one the answer has no body."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


def error_body(why: str) -> bytes:
    """Return the body of an answer with the reason why a request was refused."""
    return reply_bytes(ErrorReply(error=why))


@asynccontextmanager
async def serving(
    path: Path, handle: Handle, stops: tuple[bytes, ...] = ()
) -> AsyncIterator[CallerPrograms]:
    """Serve requests on a unix socket while the block runs; yield its callers for a supervisor.

    Parameters
    ----------
    path : path of the socket, in a folder of this user alone; one left by a killed process is
        replaced
    handle : takes peer, method, path and body, returns HTTP status and body (JSON)
    stops : first bytes of the requests that stop the cell

    Raises
    ------
    ControlError : the socket cannot be made
    """
    door = Door(handle)
    try:
        listening = _listen(path)
    except OSError as error:
        raise ControlError(
            say(
                "{path}: {strerror}; it is the control socket",
                path=path,
                strerror=error.strerror or error,
            )
        ) from error
    server = await asyncio.start_unix_server(door.on_connection, sock=listening)
    try:
        yield CallerPrograms(listening, stops, door.take)
    finally:
        server.close()
        await door.aclose()
        await server.wait_closed()
        _remove(path)


def _listen(path: Path) -> socket.socket:
    """Return a socket bound to a path, for this user alone."""
    # the caller has the cell's lock: whoever made a socket here before is gone
    path.unlink(missing_ok=True)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        listening.bind(str(path))
    except OSError:
        listening.close()
        raise
    finally:
        os.umask(before)
    return listening


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


class Door:
    """The connections of one socket.

    Parameters
    ----------
    handle : takes peer, method, path and body, returns HTTP status and body (JSON)
    """

    def __init__(self, handle: Handle) -> None:
        self._handle = handle
        self._tasks: set[asyncio.Task[Any]] = set()
        # By process, in the order in which they came: no request has arrived, or it is answered.
        self._idle: dict[asyncio.StreamWriter, int] = {}
        self._answering: Counter[bool] = Counter()  # whether they only read

    async def on_connection(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Take one request and answer it."""
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            await self._serve(reader, writer)
        except (OSError, TimeoutError, asyncio.IncompleteReadError):
            log.debug("a connection to the control socket broke off")
        finally:
            self._tasks.discard(task)
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    def take(self, connection: socket.socket) -> None:
        """Take one request from a connection that was accepted elsewhere, and answer it."""
        task = asyncio.create_task(self._take(connection), name="caller")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _take(self, connection: socket.socket) -> None:
        await self.on_connection(*await asyncio.open_unix_connection(sock=connection))

    async def aclose(self) -> None:
        """Cancel all requests still being answered."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = peer_of(writer.get_extra_info("socket"))
        wire = h11.Connection(h11.SERVER, max_incomplete_event_size=MAX_HEADER_BYTES)
        try:
            with self._resting(writer, peer):
                async with asyncio.timeout(IO_LIMIT_WALL_S):
                    request = await _read(wire, reader)
            if peer.uid != os.getuid():
                raise _BadRequestError(403, key("this cell belongs to another user"))
            status, body = await self._answer(peer, request)
        except _BadRequestError as bad:
            status, body = bad.status, error_body(str(bad)) if str(bad) else b""
        except h11.RemoteProtocolError as error:
            status, body = error.error_status_hint, error_body(f"this is no HTTP request: {error}")
        except TimeoutError:
            status, body = 408, error_body("the request did not arrive in time")
        if writer.is_closing():  # another connection has its place
            return
        with self._resting(writer, peer):
            async with asyncio.timeout(IO_LIMIT_WALL_S):
                await _write(wire, writer, status, body)
                # a socket that is closed with bytes unread loses the answer on its way
                writer.write_eof()
                for _ in range(MAX_BODY_BYTES // CHUNK_BYTES):
                    if not await reader.read(CHUNK_BYTES):
                        break

    @contextmanager
    def _resting(self, writer: asyncio.StreamWriter, peer: Peer) -> Iterator[None]:
        """Count a connection as idle; if there are too many, the oldest of one process ends.

        It belongs to the process with the most connections, so that a process with a single one
        keeps it, however many another one opens.
        """
        self._idle[writer] = peer.pid
        while len(self._idle) > MAX_CONNECTION_COUNT:
            count = Counter(self._idle.values())
            oldest = max(self._idle, key=lambda one: count[self._idle[one]])  # the first of equals
            del self._idle[oldest]
            oldest.transport.abort()
        try:
            yield
        finally:
            self._idle.pop(writer, None)

    async def _answer(self, peer: Peer, request: _Request) -> Answer:
        is_reading = request.method == "GET"
        if self._answering[is_reading] >= MAX_CONNECTION_COUNT:
            raise _BadRequestError(
                503,
                say(
                    "{max_connection_count} such requests to this cell are waiting, "
                    "the most allowed at once: ask again",
                    max_connection_count=MAX_CONNECTION_COUNT,
                ),
            )
        self._answering[is_reading] += 1
        try:
            return await self._handle(peer, request.method, request.path, request.body)
        except Exception:
            # a bug must not stop the cell, and its traceback is nobody's business out there
            log.exception("the control socket failed in %s %s", request.method, request.path)
            return 500, error_body("internal error; the log has its details")
        finally:
            self._answering[is_reading] -= 1


async def _read(wire: h11.Connection, reader: asyncio.StreamReader) -> _Request:
    """Return the next request; raise an error that says why it is malformed."""
    request: h11.Request | None = None
    body = bytearray()
    while True:
        event = wire.next_event()
        if event is h11.NEED_DATA:
            if wire.they_are_waiting_for_100_continue:
                raise _BadRequestError(417, key("send the body with the request"))
            wire.receive_data(await reader.read(CHUNK_BYTES))
        elif isinstance(event, h11.Request):
            request = event
            if request.method == b"HEAD":  # an answer to it must not have a body
                raise _BadRequestError(405, "")
        elif isinstance(event, h11.Data):
            body += event.data
            if len(body) > MAX_BODY_BYTES:
                raise _BadRequestError(
                    413,
                    say("a body has {max_body_bytes} bytes at most", max_body_bytes=MAX_BODY_BYTES),
                )
        elif isinstance(event, h11.EndOfMessage) and request is not None:
            method, target = request.method.decode(), request.target.decode("latin-1")
            return _Request(method, target.partition("?")[0], bytes(body))
        else:  # the other end has left, or wants another protocol
            raise _BadRequestError(400, key("the request breaks off"))


async def _write(
    wire: h11.Connection, writer: asyncio.StreamWriter, status: int, body: bytes
) -> None:
    if wire.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
        return
    headers = [
        ("Content-Type", "application/json"),
        ("Content-Length", str(len(body))),
        ("Connection", "close"),
    ]
    for event in (
        h11.Response(status_code=status, headers=headers),
        h11.Data(data=body),
        h11.EndOfMessage(),
    ):
        writer.write(wire.send(event) or b"")
    await writer.drain()
