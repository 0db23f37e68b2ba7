"""What tests of wires share: a wire that is served and begun again, an outbox, and patience."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Protocol

from controller.plant.model import Notice
from controller.plant.plant import Courier, Plant, RejectedError, Wire

PATIENCE_S = 90.0  # a guard against a hang on a busy machine, no measure
AGAIN_S = 0.1


class _Lines(Protocol):
    lines: list[str]


async def eventually(is_so: Callable[[], bool], what: str = "") -> None:
    """Wait until something is so."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not is_so():  # noqa: ASYNC110 - strangers set no event
                await asyncio.sleep(0.02)
    except TimeoutError:
        raise AssertionError(f"never came: {what or is_so}") from None


def is_listening(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


async def heard(by: _Lines, *words: str) -> str:
    """Return the first line with all these words, once it is there."""

    def found() -> list[str]:
        return [line for line in by.lines if all(word in line for word in words)]

    await eventually(lambda: bool(found()), f"a line with {words} among {by.lines[-5:]}")
    return found()[0]


@asynccontextmanager
async def served(wire: Wire, plant: Plant) -> AsyncIterator[list[Exception]]:
    """Serve a wire for the time of a block, and begin again when it ends; yields its errors."""
    errors: list[Exception] = []

    async def keep_serving() -> None:
        while True:
            try:
                await wire.serve(plant)
            except (OSError, TimeoutError, RejectedError) as error:
                errors.append(error)
            await asyncio.sleep(AGAIN_S)

    task = asyncio.create_task(keep_serving())
    try:
        yield errors
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def deliver_surely(courier: Courier, notice: Notice) -> None:
    """Deliver as the outbox does: again until the receiver has confirmed it."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                return await courier.deliver(notice)
            except (OSError, TimeoutError):
                await asyncio.sleep(AGAIN_S)
