"""A story of a test on a simulated cell: a loop of its own for each, closed whatever happens."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

from simulation.cell import Scene, SimulatedCell
from simulation.loop import SimulatedLoop

SEED = 5
Teller = TypeVar("Teller")


def play(
    folder: Path,
    teller: Callable[[SimulatedLoop, SimulatedCell, Path], Teller],
    story: Callable[[Teller], Awaitable[Any]],
    watchdog_s: float | None = None,
) -> None:
    """Run a story on a loop of its own.

    Parameters
    ----------
    folder : for the cell's files, and for what comes of it
    teller : makes what the story is about, of the loop, the cell and a folder that is not there yet
    story : what happens
    watchdog_s : of a watchdog in the motors' supply; None for none [s]
    """
    loop = SimulatedLoop(SEED)
    cell = SimulatedCell(loop, SEED, Scene("holder", watchdog_s=watchdog_s), folder / "cell")

    async def all_of_it() -> None:
        async with cell:
            await story(teller(loop, cell, folder / "out"))

    try:
        loop.run_until_complete(all_of_it())
    finally:
        cell.close()
        loop.bury()
        loop.close()
