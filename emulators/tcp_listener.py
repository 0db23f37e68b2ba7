"""Listening sockets of emulated devices: who is connected, and how connections end."""

import asyncio
import contextlib
from abc import ABC, abstractmethod
from typing import ClassVar


class TcpListener(ABC):
    """Owns a listening socket and a task for each client; leaves none behind.

    Started again after `aclose`, it listens on the same port, as a device does after a restart.

    Attributes
    ----------
    is_reachable : False: the network lies between; connections end at once, old and new
    """

    ended_by: ClassVar[tuple[type[Exception], ...]] = (ConnectionError,)
    """Errors by which a connection is reset, and nothing else happens."""

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._server: asyncio.Server | None = None
        self._clients: dict[asyncio.Task[None], asyncio.StreamWriter] = {}
        self.is_reachable = True

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        OSError : the port is taken
        ValueError : it has been started already
        """
        if self._server is not None:
            raise ValueError("started already")
        self._server = await asyncio.start_server(self._accept, self._host, self._port)
        self._port = self._server.sockets[0].getsockname()[1]

    @property
    def address(self) -> tuple[str, int]:
        """Host and port.

        Raises
        ------
        ValueError : it has not been started
        """
        if self._server is None:
            raise ValueError("not started")
        return self._host, self._port

    @property
    def client_count(self) -> int:
        """The number of connected clients."""
        return len(self._clients)

    def drop_connections(self) -> None:
        """Reset every connection, as a device does that loses its power; it goes on listening."""
        for writer in self._clients.values():
            writer.transport.abort()

    async def aclose(self) -> None:
        """Close the socket and every connection."""
        if self._server is None:
            return
        self._server.close()
        tasks = list(self._clients)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._server.wait_closed()
        self._server = None

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if not self.is_reachable:
            writer.transport.abort()
            return
        task = asyncio.get_running_loop().create_task(self._run(reader, writer))
        self._clients[task] = writer
        task.add_done_callback(self._forget)

    def _forget(self, task: asyncio.Task[None]) -> None:
        writer = self._clients.pop(task)
        writer.transport.abort()  # a task cancelled before its first step has closed nothing
        if not task.cancelled():
            task.result()  # a bug of ours surfaces in the loop's exception handler

    async def _run(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await self._serve(reader, writer)
        except self.ended_by:
            writer.transport.abort()
        finally:
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()

    @abstractmethod
    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client until it leaves."""
