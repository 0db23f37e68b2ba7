"""Work that the cancellation of its caller must not cut short, such as a stop on its way."""

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def run_to_end(work: Coroutine[Any, Any, T]) -> T:
    """Await `work` to its end, then cancel a caller that was cancelled; return its result.

    `work` must be bounded in time. If it fails while the caller is being cancelled, the
    cancellation wins.

    Raises
    ------
    CancelledError : the caller was cancelled while ``work`` ran; ``work`` has ended by then
    """
    task = asyncio.create_task(work)
    was_cancelled = False
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError:
            was_cancelled = True
    if was_cancelled:
        if not task.cancelled():
            task.exception()  # retrieved, so that asyncio does not warn about it
        raise asyncio.CancelledError
    return task.result()
