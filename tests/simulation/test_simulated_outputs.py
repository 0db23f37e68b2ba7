"""24 V signals of simulated runs, as the emulated block's contacts have them at each instant."""

from __future__ import annotations

import asyncio
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import pytest

from simulation.cell import Scene, SimulatedCell
from simulation.loop import SimulatedLoop

SEED = 5
NAMES = ("ready", "busy", "result_valid", "accept", "reject", "fault")
BEFALL: Final[dict[str, dict[str, Any]]] = {"estop": {"pressed": True}}
WATCHDOG_S = 1.0  # of the emulated block, where the cell file gives none


class Contacts:
    """The outputs of the block at each slice of the world."""

    def __init__(self, cell: SimulatedCell) -> None:
        self._cell = cell
        self.seen: list[tuple[float, frozenset[str]]] = []

    @property
    def on(self) -> frozenset[str]:
        io = self._cell.cell.io
        return frozenset(name for number, name in enumerate(NAMES) if io.is_closed(number))

    def look(self) -> None:
        self.seen.append((self._cell.now_s(), self.on))

    @property
    def steps(self) -> list[frozenset[str]]:
        return [on for on, _ in groupby(on for _, on in self.seen)]


def story(folder: Path, befall: str = "", in_state: str = "") -> tuple[str, Contacts]:
    """Run one part; return how it ended, and the contacts. Something may befall it in a state."""
    loop = SimulatedLoop(SEED)
    # from this place the run ends between two looks at the contacts, so that all steps show
    scene = Scene("holder", place=1, outputs=NAMES)
    cell = SimulatedCell(loop, SEED, scene, folder / "cell")
    contacts = Contacts(cell)

    async def told() -> str:
        async with cell:
            cell.after_slice = contacts.look
            controller = cell.controller()
            task = controller.start()
            killed = asyncio.Event()

            def on_state(state: str) -> None:
                if state == in_state and befall == "kill":
                    loop.call_soon(killed.set)
                elif state == in_state:
                    cell.befall(befall, **BEFALL[befall])

            controller.on_state = on_state
            over = asyncio.ensure_future(killed.wait())
            await asyncio.wait({task, over}, return_when=asyncio.FIRST_COMPLETED)
            over.cancel()
            if killed.is_set():
                controller.kill()
            await asyncio.sleep(1.5 * WATCHDOG_S)
            cell.catch_up()
            return "killed" if killed.is_set() else task.result().outcome.end

    try:
        return loop.run_until_complete(told()), contacts
    finally:
        cell.close()
        loop.bury()
        loop.close()


def test_a_whole_run_tells_its_part_once_and_ends_with_all_off(tmp_path: Path) -> None:
    end, contacts = story(tmp_path)
    assert end == "complete"
    *steps, last = (" ".join(sorted(on)) for on in contacts.steps)
    assert steps[:7] == [
        *("", "busy", "ready", "busy"),
        *("accept busy", "accept busy result_valid", "accept result_valid"),
    ]
    assert {*steps[7:], last} <= {"accept", ""}
    assert last == ""


@pytest.mark.parametrize(
    "state", ["inspecting", pytest.param("completing", marks=pytest.mark.slow)]
)
def test_a_run_that_is_killed_leaves_no_output_on_for_longer_than_the_watchdog(
    tmp_path: Path, state: str
) -> None:
    end, contacts = story(tmp_path, "kill", state)
    assert end == "killed"
    assert contacts.on == frozenset()
    assert any("busy" in on for _, on in contacts.seen)


def test_an_emergency_stop_is_told_as_a_fault_and_the_end_as_nothing(tmp_path: Path) -> None:
    end, contacts = story(tmp_path, "estop", "inspecting")
    assert end == "aborted"
    assert contacts.steps[-2:] == [frozenset({"fault"}), frozenset()]
    assert not any("accept" in on or "result_valid" in on for _, on in contacts.seen)
