"""Programs of emulated devices without a cell: one alone, or steered by JSON lines."""

import argparse
import asyncio
import contextlib
import json
import signal
import sys
from collections.abc import Callable, Coroutine
from typing import Any, Final, Protocol

PORT: Final = 5020  # of a device served alone


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


def serve_alone(
    serve: Callable[[int], contextlib.AbstractAsyncContextManager[str]], about: str | None
) -> None:
    """Serve one device at ``--port`` until the program is ended; print its address first.

    Parameters
    ----------
    serve : serves the device on a port, 0 for a free one, and yields its address
    about : what ``--help`` says
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--port", type=int, default=PORT)
    port = parser.parse_args().port

    async def run() -> None:
        async with serve(port) as address:
            sys.stdout.write(f"{address}\n")
            sys.stdout.flush()
            await asyncio.get_running_loop().create_future()

    with contextlib.suppress(KeyboardInterrupt):
        run_until_told(run())
