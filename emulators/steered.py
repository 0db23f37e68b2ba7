"""Emulated devices of a program without a cell, steered by JSON lines: state out, orders in."""

import asyncio
import contextlib
import json
import signal
import sys
from collections.abc import Callable, Coroutine
from typing import Any, Protocol


class Running(Protocol):
    """A server that is at work as long as `run` is."""

    async def run(self) -> None:
        """Serve until it is cancelled."""
        ...


async def obey_lines(
    server: Running, state: Callable[[], dict[str, Any]], obey: Callable[[dict[str, Any]], None]
) -> None:
    """Run a server, print its state, obey each line of stdin and print the state again.

    Ends with stdin.

    Parameters
    ----------
    server : started
    state : returns what is printed
    obey : carries out an order
    """
    orders = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(orders), sys.stdin
    )

    def say() -> None:
        sys.stdout.write(json.dumps(state()) + "\n")
        sys.stdout.flush()

    async with asyncio.TaskGroup() as tasks:
        serving = tasks.create_task(server.run())
        say()
        while line := await orders.readline():
            obey(json.loads(line))
            say()
        serving.cancel()


def run_until_told(work: Coroutine[Any, Any, None]) -> None:
    """Run a program; SIGTERM cancels it, so that it leaves no socket and no mount behind."""

    async def until_told() -> None:
        main = asyncio.ensure_future(work)
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, main.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            await main

    asyncio.run(until_told())
