"""The control port: here tests read the truth and cause faults. The controller never uses it.

JSON lines on a unix socket; each ``{"do": VERB, ...}`` is answered by one
``{"ok": true, ...}`` or ``{"ok": false, "error": ...}``. The verbs are docs/emulator-faults.md's.
"""

import asyncio
import contextlib
import json
import socket
from pathlib import Path
from typing import Any, Final, Protocol

from emulators.owned import bind_owned

LINE_BYTES: Final = 4 << 20  # a script of the most steps fits in it
TOO_LONG: Final = {"ok": False, "error": f"a line has {LINE_BYTES >> 20} MiB at most"}


class Obedient(Protocol):
    """Whoever carries the verbs out."""

    def obey(self, line: bytes) -> dict[str, Any]:
        """Carry out one line of JSON and return its answer."""
        ...


class ControlPort:
    """Serves verbs on a unix socket of the owner's alone."""

    def __init__(self, verbs: Obedient, path: Path) -> None:
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
        self._server = await asyncio.start_unix_server(self._serve, sock=listener, limit=LINE_BYTES)

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
            while (line := await _line(reader)) != b"":
                answer = TOO_LONG if line is None else self._verbs.obey(line)
                writer.write(json.dumps(answer).encode() + b"\n")
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            self._clients.discard(writer)
            writer.close()


async def _line(reader: asyncio.StreamReader) -> bytes | None:
    """Return the next line, b"" at the end, None for one that is too long."""
    is_long = False
    while True:
        try:
            line = await reader.readuntil(b"\n")
        except asyncio.LimitOverrunError as error:
            await reader.readexactly(error.consumed)
            is_long = True
        except asyncio.IncompleteReadError as error:
            return error.partial
        else:
            return None if is_long else line
