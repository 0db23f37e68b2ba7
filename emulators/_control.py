"""The control port: here tests read the truth and cause faults. The controller never uses it.

JSON lines on a unix socket; each ``{"do": VERB, ...}`` is answered by one
``{"ok": true, ...}`` or ``{"ok": false, "error": ...}``. The verbs are docs/emulator-faults.md's.
"""

import asyncio
import contextlib
import json
import socket
from pathlib import Path

from emulators.faults import Verbs
from emulators.owned import bind_owned


class ControlPort:
    """Serves a cell's verbs on a unix socket of the owner's alone."""

    def __init__(self, verbs: Verbs, path: Path) -> None:
        self._verbs, self._path = verbs, path
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()

    async def start(self) -> None:
        """Listen."""
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            bind_owned(listener, self._path)
        except OSError:
            listener.close()
            raise
        self._server = await asyncio.start_unix_server(self._serve, sock=listener)

    async def aclose(self) -> None:
        """Close the socket and delete it."""
        if self._server is None:
            return
        self._server.close()
        for writer in list(self._clients):
            writer.close()
        await self._server.wait_closed()
        self._server = None
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        try:
            while line := await reader.readline():
                writer.write(json.dumps(self._verbs.obey(line)).encode() + b"\n")
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            self._clients.discard(writer)
            writer.close()
