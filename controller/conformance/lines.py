"""Disturbances of the line between a driver and its device: by a relay, a verb, or a person."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Protocol

HOST_PORT: Final = re.compile(r"(?P<host>[\w.-]+):(?P<port>\d{1,5})")
_CHUNK: Final = 4096


class DeviceLine(Protocol):
    """The line to a device.

    Attributes
    ----------
    sent_count : bytes that have gone to the device; stays 0 where nobody counts
    counts_bytes : whether somebody counts
    """

    @property
    def sent_count(self) -> int: ...  # noqa: D102  (an attribute)

    @property
    def counts_bytes(self) -> bool: ...  # noqa: D102  (an attribute)

    async def silence(self) -> None:
        """Let no byte through, either way; the connection stays."""
        ...

    async def cut(self) -> None:
        """End the connection, and refuse new ones."""
        ...

    async def mend(self) -> None:
        """Let everything through again."""
        ...

    async def aclose(self) -> None:
        """Mend it, and let go of it."""
        ...


class PortRelay:
    """A relay between a driver and a device on a TCP port, on a port of its own.

    Parameters
    ----------
    address : ``host:port`` of the device
    """

    counts_bytes = True

    def __init__(self, address: str) -> None:
        match = HOST_PORT.fullmatch(address)
        if match is None:
            raise ValueError(f"`{address}` is not host:port")
        self._host, self._port = match["host"], int(match["port"])
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._pumps: set[asyncio.Task[None]] = set()
        self._is_silent = self._is_cut = False
        self.sent_count = 0

    async def start(self) -> str:
        """Listen; return the address that the driver is given."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return f"127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    async def silence(self) -> None:
        """Let no byte through."""
        self._is_silent = True

    async def cut(self) -> None:
        """End all connections, and every new one at once."""
        self._is_cut = True
        self._drop()

    async def mend(self) -> None:
        """Let everything through again; bytes lost meanwhile stay lost."""
        self._is_silent = self._is_cut = False

    async def aclose(self) -> None:
        """Stop listening, end all connections."""
        if self._server is not None:
            self._server.close()
            self._server = None
        self._drop()
        for pump in self._pumps:
            pump.cancel()
        await asyncio.gather(*self._pumps, return_exceptions=True)

    def _drop(self) -> None:
        for writer in tuple(self._writers):
            writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._pumps.add(task)
        self._writers.add(writer)
        try:
            if self._is_cut:
                return
            with suppress(OSError):
                there, to_device = await asyncio.open_connection(self._host, self._port)
                self._writers.add(to_device)
                try:
                    async with asyncio.TaskGroup() as group:
                        group.create_task(self._pump(reader, to_device, is_request=True))
                        group.create_task(self._pump(there, writer, is_request=False))
                finally:
                    self._writers.discard(to_device)
                    to_device.close()
        except asyncio.CancelledError:
            if self._server is not None:
                raise
            # `aclose` ends it; the stream that called it has nobody to tell, and would log it
        finally:
            self._writers.discard(writer)
            self._pumps.discard(task)
            writer.close()

    async def _pump(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, is_request: bool
    ) -> None:
        with suppress(OSError):
            while data := await reader.read(_CHUNK):
                if is_request:
                    self.sent_count += len(data)
                if not self._is_silent:
                    writer.write(data)
                    await writer.drain()
        writer.close()


class EmulatedLine:
    """The line to an emulated device without a TCP port, disturbed by the emulator's verbs.

    Parameters
    ----------
    control : the emulator's control socket
    silence, cut, mend : orders to it, as docs/emulator-faults.md has them
    """

    sent_count = 0
    counts_bytes = False

    def __init__(
        self,
        control: Path,
        *,
        silence: dict[str, Any],
        cut: dict[str, Any],
        mend: dict[str, Any],
    ) -> None:
        self._control = control
        self._orders = {"silence": silence, "cut": cut, "mend": mend}
        self._is_disturbed = False

    @classmethod
    def of_arm(cls, control: Path) -> EmulatedLine:
        """Return the arm's serial line."""
        off = {"do": "arm_line", "unplugged": True}
        return cls(control, silence=off, cut=off, mend=off | {"unplugged": False})

    @classmethod
    def of_camera(cls, control: Path, name: str) -> EmulatedLine:
        """Return a camera's cable."""
        off = {"do": "unplug", "camera": name}
        return cls(control, silence=off, cut=off, mend={"do": "plug", "camera": name})

    async def silence(self) -> None:
        """Let no byte through."""
        self._is_disturbed = True
        await self._order("silence")

    async def cut(self) -> None:
        """Pull the plug."""
        self._is_disturbed = True
        await self._order("cut")

    async def mend(self) -> None:
        """Plug it in again."""
        if self._is_disturbed:
            self._is_disturbed = False
            await self._order("mend")

    async def aclose(self) -> None:
        """Mend it."""
        with suppress(OSError):
            await self.mend()

    async def _order(self, what: str) -> None:
        reader, writer = await asyncio.open_unix_connection(str(self._control))
        try:
            writer.write(json.dumps(self._orders[what]).encode() + b"\n")
            answer = json.loads(await reader.readline())
        finally:
            writer.close()
        if not answer["ok"]:
            raise OSError(f"the emulated cell refused {what}: {answer['error']}")


class PersonsLine:
    """A line that a person unplugs and plugs in again when requested.

    Parameters
    ----------
    name : name of the device
    prompt : shows a request and returns whether the person has done it
    """

    sent_count = 0
    counts_bytes = False

    def __init__(self, name: str, prompt: Callable[[str], bool]) -> None:
        self._name, self._prompt = name, prompt
        self._is_disturbed = False

    async def silence(self) -> None:
        """Have the data cable pulled."""
        await self._have(f"Unplug the data cable of `{self._name}`")
        self._is_disturbed = True

    async def cut(self) -> None:
        """Have the data cable pulled."""
        await self.silence()

    async def mend(self) -> None:
        """Have it plugged in again."""
        if self._is_disturbed:
            await self._have(f"Plug the data cable of `{self._name}` in again")
            self._is_disturbed = False

    async def aclose(self) -> None:
        """Have it plugged in again."""
        with suppress(InterruptedError):
            await self.mend()

    async def _have(self, request: str) -> None:
        if not await asyncio.to_thread(self._prompt, request):
            raise InterruptedError("nobody at the terminal disturbed the line")
