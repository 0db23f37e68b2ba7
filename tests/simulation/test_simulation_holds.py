"""Holds fail as often as was ordered, each at a moment at which its gripper has the part alone."""

import asyncio
from collections import Counter
from collections.abc import Coroutine
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest

from simulation.faults import Cause, Fault
from simulation.holds import Holds
from simulation.loop import SimulatedLoop

HOLD_S = 20.0
SHARED_S = 2.0  # of a hand-off
PARTS = 1500


class Cell:
    """A cell that hands parts from the arm to the fixed gripper and back, whatever befalls it."""

    def __init__(self, loop: SimulatedLoop, rate: float, hold_s: float = HOLD_S) -> None:
        self.loop = loop
        self.watch = SimpleNamespace(on_event=None)
        self.custody = ""
        self.misses = {"arm": False, "fixture": False}
        self.befell: list[tuple[str, str]] = []  # what, and who had the part
        self.tasks: set[asyncio.Task[None]] = set()
        lengths = dict.fromkeys(("arm", "fixture from arm", "arm from fixture"), (hold_s,))
        self.holds = Holds(cast(Cause, self), rate, Random("holds"), lengths)

    def now(self, fault: Fault) -> None:
        self.befell.append((fault.name, self.custody))
        if fault.name.startswith("missed"):
            self.misses["fixture" if "hand-off" in fault.name else "arm"] = True

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        self.tasks.add(self.loop.create_task(work))

    def note(self, what: str, by: str) -> None:
        event = SimpleNamespace(what=what, by=by, at_s=self.loop.time())
        self.watch.on_event(event)

    async def take(self, gripper: str) -> None:
        while self.misses[gripper]:
            self.misses[gripper] = False
            self.note("missed", gripper)
            await asyncio.sleep(1.0)
        self.custody = f"{self.custody}+{gripper}".strip("+")
        self.note("gripped", gripper)

    async def hand_on(self, giver: str, taker: str) -> None:
        await asyncio.sleep(HOLD_S)
        await self.take(taker)
        await asyncio.sleep(SHARED_S)
        self.custody = taker
        self.note("released", giver)

    async def work(self) -> None:
        self.holds.begin()
        for _ in range(PARTS):
            await self.take("arm")
            await self.hand_on("arm", "fixture")
            await self.hand_on("fixture", "arm")
            await asyncio.sleep(HOLD_S)
            self.custody = ""
            self.note("released", "arm")


def worked(rate: float, hold_s: float = HOLD_S) -> Cell:
    loop = SimulatedLoop(1)
    try:
        cell = Cell(loop, rate, hold_s)
        loop.run_until_complete(cell.work())
        return cell
    finally:
        loop.bury()
        loop.close()


@pytest.mark.parametrize("hold_s", [HOLD_S, 1.3 * HOLD_S], ids=["as long", "shorter than known"])
def test_as_many_holds_fail_as_were_ordered_and_each_kind_equally_often(hold_s: float) -> None:
    cell = worked(0.05, hold_s)
    failed = cell.holds.fault_count / len(cell.holds.made)
    assert failed == pytest.approx(0.05, abs=0.01)  # three standard deviations of 4500 draws
    kinds = Counter(name.split()[0] for name, _ in cell.befell)
    assert set(kinds) == {"missed", "drop", "slip"}
    assert min(kinds.values()) > 0.6 * max(kinds.values())


def test_a_drop_or_slip_comes_while_one_gripper_has_the_part_alone() -> None:
    cell = worked(1.0)
    late = [(name, who) for name, who in cell.befell if not name.startswith("missed")]
    assert late
    assert all(name.split()[2] == who for name, who in late)


def test_without_faults_the_length_of_every_kind_of_hold_is_known() -> None:
    seen = worked(0.0).holds.lengths_seen()
    assert set(seen) == {"arm", "fixture from arm", "arm from fixture"}
    assert all(length_s == pytest.approx(HOLD_S) for one in seen.values() for length_s in one)
