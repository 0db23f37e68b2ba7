"""The kernel's delay of bytes written to a terminal, measured by a byte of our own."""

import asyncio
import contextlib
import os
import tty
from typing import Final

# longest wait for the kernel; data still missing then counts as missing
LATEST_WALL_S: Final = 10.0


async def through_the_kernel() -> None:
    """Wait until a byte written now to a pseudo-terminal of our own can be read.

    The kernel passes on the bytes of all pseudo-terminals from one queue of work, in order: bytes
    written to another one before are then through as well, or about to be.
    """
    loop = asyncio.get_running_loop()
    has_come = asyncio.Event()
    reading, writing = os.openpty()
    try:
        tty.setraw(writing)
        loop.add_reader(reading, has_come.set)
        os.write(writing, b"\0")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LATEST_WALL_S):
                await has_come.wait()
    finally:
        loop.remove_reader(reading)
        os.close(reading)
        os.close(writing)
